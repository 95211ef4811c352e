"""Layers of image files: their names and stored values."""

import logging
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError, SettingsError
from mpsnet_core.io.file_kinds import file_head, stated_beside, webp_orientation
from mpsnet_core.io.files import RAW_SUFFIXES
from mpsnet_core.io.image import MAX_PIXELS, oriented
from mpsnet_core.io.image_input import channel_names, image_attribute, open_image, pending_error, silence_libraries
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)

# Names of the attributes with the format's name, and whether the file has a palette.
FORMAT, PALETTE = "mpsnet:format", "mpsnet:palette"

# Checked before any memory is allocated: a broken or hostile header can claim any number.
MAX_CHANNELS = 1024
MAX_TILE = 1 << 24  # pixels; a tile is decoded completely, even if the image covers little of it
MAX_LAYER_VALUES = 4 * MAX_PIXELS  # over all channels that are read at once


@dataclass(frozen=True)
class _Layer:
    """A layer's channels."""

    subimage: int
    """Index of the file's subimage (part) that holds it."""
    channels: dict[str, int]
    """Channel indices by their short names."""


def image_layers(path: AnyPath) -> list[str]:
    """Names of the layers in a file, "" for channels without a layer name. Parts of multi-part EXRs are layers, too."""
    path = Path(path)
    with closing(open_image(path)) as source, silence_libraries():
        return list(layers_of(source, path))


def layer_in(path: AnyPath, layer: str | None) -> str | None:
    """The layer to read from a companion file of a photo with this `layer`: the same, if the file has several."""
    if layer is None or Path(path).suffix.lower() in RAW_SUFFIXES:
        return None
    return layer if len(image_layers(path)) > 1 else None


def read_layer(path: Path, layer: str | None) -> tuple[NDArray[Any], dict[str, int], Any]:
    """All values of a layer (H, W, C) as stored, its channel indices by short name, and the file's spec.

    Integers of 8 and 16 bits stay integers, all else is float32.
    Raises FileError, FormatError or SettingsError as :func:`mpsnet_core.io.image_reading.read_image` does.
    """
    with closing(open_image(path)) as source, silence_libraries():
        reason = pending_error(source)  # progressive JPEGs are decoded on opening
        is_whole_picture = source.format_name() == "png"  # its offset is a position on a page
        chosen = choose_layer(layers_of(source, path), layer, path)
        source.seek_subimage(chosen.subimage, 0)
        spec = source.spec()
        spec.attribute(FORMAT, source.format_name())
        spec.attribute(PALETTE, int(has_palette(path, spec)))
        orientation = orientation_of(spec, path)
        spec.attribute("Orientation", orientation)
        for name, value in stated_beside(path, source.format_name()).items():
            spec.attribute(name, value)
        first, last = min(chosen.channels.values()), max(chosen.channels.values())
        if spec.width * spec.height * (last + 1 - first) > MAX_LAYER_VALUES:
            raise FormatError(
                f"{path} has {last + 1 - first} channels in a layer of {spec.width} x {spec.height}, more than this "
                "program reads; export the photo alone"
            )
        kind = spec.format.basetype if spec.format.basetype in (oiio.UINT8, oiio.UINT16) else oiio.FLOAT
        values = source.read_image(chosen.subimage, 0, first, last + 1, kind)
        reason = reason or pending_error(source)
    if "not configured" in reason or "not implemented" in reason:
        raise FormatError(f"{path} is compressed in a way that is not supported ({reason}); save it with LZW or ZIP")
    if values is None or reason:
        raise FormatError(f"{path} is damaged or cut short ({reason or 'no pixels'}); copy or export it again")
    values = np.asarray(values).reshape(spec.height, spec.width, last + 1 - first)
    if not is_whole_picture:
        values = _on_display_window(values, spec)
    values = oriented(values, orientation)
    return values, {name: number - first for name, number in chosen.channels.items()}, spec


def layers_of(source: Any, path: Path) -> dict[str, _Layer]:
    """The layers of an open file by name. Raises FormatError if it claims to exceed a limit."""
    layers: dict[str, _Layer] = {}
    sizes: list[tuple[int, int]] = []  # pixels and channels of each part
    subimage = 0
    while source.seek_subimage(subimage, 0):
        spec = source.spec()
        if (
            max(spec.width * spec.height, spec.full_width * spec.full_height) > MAX_PIXELS
            or spec.nchannels > MAX_CHANNELS
            or spec.depth > 1
            or spec.tile_width * spec.tile_height > MAX_TILE
        ):
            raise FormatError(
                f"{path} claims to be {spec.width} x {spec.height} with {spec.nchannels} channels, more than this "
                f"program reads ({MAX_PIXELS // 10**6} megapixels, {MAX_CHANNELS} channels, no volumes, no tiles above "
                f"{MAX_TILE // 10**6} megapixels)"
            )
        part = image_attribute(spec, "oiio:subimagename", str) or ""
        names = channel_names(spec, path)
        for number, channel in enumerate(names):
            prefix, _, name = channel.rpartition(".")
            # Blender 5 writes a part per pass, and repeats its name in the channels only if the pass has a layer.
            layer = prefix or (part if subimage or not has_colours(names) else "")
            found = layers.setdefault(layer, _Layer(subimage, {}))
            if found.subimage == subimage:
                found.channels.setdefault(_short(name, spec.nchannels), number)
            elif _is_larger_page(source, spec, sizes[found.subimage]):
                # Of a TIFF's pages, all unnamed, the largest is read: others are previews.
                log.info("%s has several pages; the largest is read, %d x %d", path, spec.width, spec.height)
                layers[layer] = _Layer(subimage, {_short(name, spec.nchannels): number})
        sizes.append((spec.width * spec.height, spec.nchannels))
        subimage += 1
        if source.format_name() == "webp":  # its reader does not come back from the end of an animation
            break
    pending_error(source)  # clears that of seeking past the last part
    return layers


def _is_larger_page(source: Any, spec: Any, first: tuple[int, int]) -> bool:
    """Whether a page of a TIFF is the picture of which the first is a preview. first: its pixels and channels."""
    return bool(source.format_name() == "tiff" and spec.width * spec.height > first[0] and spec.nchannels >= first[1])


def has_colours(names: Iterable[str]) -> bool:
    """Whether channels are red, green and blue, by their short names."""
    return {"R", "G", "B"}.issubset(names)


def _short(name: str, count: int) -> str:
    """A file's channel name as R, G, B, A, X, Y or Z, if it is one of these."""
    if count > 1 and name.lower() in ("red", "green", "blue", "alpha"):
        return name[0].upper()
    return name.upper() if len(name) == 1 else name


def choose_layer(layers: dict[str, _Layer], wanted: str | None, path: Path) -> _Layer:
    """The layer of that name, or the default layer if no name is given. Raises SettingsError if there is none."""
    if wanted is not None:
        matches = [name for name in layers if name == wanted or name.endswith("." + wanted)]
    elif "" in layers or len(layers) == 1:
        matches = [""] if "" in layers else list(layers)
    else:
        matches = [name for name in layers if name.rpartition(".")[2] == "Combined"]
    if len(matches) == 1:
        return layers[matches[0]]
    names = ", ".join(sorted(name or "(unnamed)" for name in layers))
    if wanted is not None and not matches:
        raise SettingsError(f"{path} has no layer {wanted!r}; it has {names}")
    raise SettingsError(f"{path} has several layers; name one of {names}")


def orientation_of(spec: Any, path: Path) -> int:
    """EXIF orientation, 1 if the file has none."""
    orientation = image_attribute(spec, "Orientation", int) or webp_orientation(path) or 1
    return orientation if 1 <= orientation <= 8 else 1


def has_palette(path: Path, spec: Any) -> bool:
    """Whether the pixels of a PNG, TGA, BMP or TIFF are numbers of colours in a table."""
    head, kind = file_head(path), spec.getattribute(FORMAT)
    if kind == "png":
        return head[25:26] == b"\3"
    if kind == "targa":
        return head[1:2] == b"\1" and head[2:3] in (b"\1", b"\x09")
    bits = image_attribute(spec, "bmp:bitsperpixel", int) or 24
    return bits <= 8 < 8 * spec.nchannels or image_attribute(spec, "tiff:PhotometricInterpretation", int) == 3


def _on_display_window(values: NDArray[T], spec: Any) -> NDArray[T]:
    """The display window of an EXR. Its data window may be smaller (a render region) or larger; gaps become zero."""
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if (top, left, spec.height, spec.width) == (0, 0, spec.full_height, spec.full_width):
        return values
    whole = np.zeros((spec.full_height, spec.full_width, values.shape[2]), values.dtype)
    rows = slice(max(top, 0), min(top + spec.height, spec.full_height))
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    if rows.start < rows.stop and columns.start < columns.stop:
        whole[rows, columns] = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole
