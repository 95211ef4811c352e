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

from mpsnet_core.arrays.row_bands import FEW_ROWS, bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.errors import FormatError, SettingsError
from mpsnet_core.io.file_kinds import EXPOSURE, FORMAT, PALETTE, file_head, stated_beside, webp_orientation
from mpsnet_core.io.files import RAW_SUFFIXES, existing_file
from mpsnet_core.io.image import MAX_PIXELS, Image, linear_to_srgb, oriented, srgb_to_linear, storage_type
from mpsnet_core.io.image_encoding import IS_LINEAR, Encoding, curve_of, identity_curve, is_float
from mpsnet_core.io.image_input import (
    channel_names,
    image_attribute,
    image_input,
    open_image,
    pending_error,
    silence_libraries,
)
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.raw import raw_size, read_raw

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)

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


# ----------------------------------------------------------------------------------------------------------------------
# Photos, masks and data read from image files.


# OpenImageIO's names of formats whose colours are never premultiplied by alpha, although it does not say so.
UNASSOCIATED = ("webp", "bmp")
# Formats whose fourth byte is often unused, and zero everywhere.
FOURTH_BYTE = ("bmp", "targa")
# Below this alpha colours that are not multiplied by it exceed it; least number of such pixels to judge by.
FAINT, MIN_OUTLINE = 0.5, 50
# Pixels whose sides differ by less than this share count as square: files round their ratio.
SAME_SIDES = 0.01
# Larger values count as not finite. It is far above the sun's radiance, and its square is finite in float32.
MAX_VALUE = 1e15


def read_image(
    path: AnyPath,
    *,
    encoding: Encoding = "auto",
    layer: str | None = None,
    grey: bool = False,
    pair: bool = False,
    compact: bool = False,
) -> Image:
    """Read a colour image, or a camera raw file if rawpy is installed.

    Parameters
    ----------
    path : path-like
        A PNG, JPEG, TIFF, EXR, WebP, BMP, TGA or HDR file, HEIC or AVIF if pillow-heif is installed, or camera raw,
        which is always linear.
    encoding : {"auto", "linear", "srgb"}, optional
        Encoding of the file's values. "auto": files with an ICC profile or a PNG gamma have its curve, other float
        files and files that state so are linear, all others are sRGB.
    layer : str, optional
        Layer of a multi-layer or multi-part EXR: its full name, or the name's last part ("Combined"). By default the
        unnamed layer, else the only one, else the one named Combined.
    grey : bool, optional
        Accept a file with one channel, too, and use it for all three.
    pair : bool, optional
        Accept a file with two channels, too, whatever they are called, and use 0 for blue.
    compact : bool, optional
        Store a large photo in half floats, if its file has at most 16 bits per channel.

    Returns
    -------
    Image

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is damaged, too large or not RGB.
    SettingsError
        If the layer is missing or ambiguous, or the encoding is unknown.
    """
    IS_LINEAR[encoding]  # reject others
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        return _read_raw(path, encoding, layer)
    values, names, spec = read_layer(path, layer)
    if pair and len(names) == 2:
        first, second = names.values()
        names = {"R": first, "G": second, "B": second}
    if image_attribute(spec, "tiff:ColorSpace", str) == "CIELAB":
        raise FormatError(f"{path} is in Lab colours, which are not supported; export it as RGB")
    colour = _colour_channels(names, grey, path)
    _warn_of_pixel_aspect(path, spec)
    if image_attribute(spec, PALETTE, int):
        log.warning("%s has a palette of at most 256 colours, too few for normals; export it without one", path)
    kind = spec.getattribute(FORMAT)
    alpha = np.clip(_as_float(values[..., names["A"]]), 0, 1) if "A" in names else None
    if alpha is not None and kind in FOURTH_BYTE and not alpha.any():
        alpha = None
    exposure = np.array([image_attribute(spec, name, float) or 1 for name in EXPOSURE], np.float32)
    decoded, assumed = curve_of(path, spec, encoding)
    unassociated = spec.getattribute("oiio:UnassociatedAlpha") or kind in UNASSOCIATED
    premultiplied = alpha is not None and not unassociated
    fits = compact and spec.format.basetype in (oiio.HALF, oiio.UINT8, oiio.UINT16)
    pixels = np.empty((*values.shape[:2], 3), storage_type(values.shape) if fits else np.float32)
    for rows in bands(len(values), FEW_ROWS):
        cover = alpha[rows] if alpha is not None and premultiplied else None
        pixels[rows] = decoded(_straight(values[rows][..., colour], exposure, cover))
        if colour[1] == colour[2] != colour[0]:
            pixels[rows, :, 2] = 0
    if alpha is not None and not premultiplied and _seems_premultiplied(values, colour, alpha):
        log.warning(
            "the colours of %s look multiplied by its alpha, which its format does not allow: edges are "
            "too dark; export it with straight alpha",
            path,
        )
    # Other curves end at 1.
    clip = np.inf if is_float(spec) and decoded in (identity_curve, srgb_to_linear, linear_to_srgb) else 1.0
    orientation = image_attribute(spec, "Orientation", int)
    return Image(pixels, alpha, clip, None, _exposure_time(spec), assumed, orientation)


def _straight(values: NDArray[Any], exposure: F32, cover: F32 | None) -> F32:
    """Colours (H, W, 3) without the exposure that their file states, nor the alpha that they are multiplied by."""
    colours = _as_float(values)
    colours /= exposure
    if cover is None:
        return colours
    # A colour without coverage is pure emission; some renderers write every pixel that way.
    return np.divide(colours, cover[..., None], out=colours, where=cover[..., None] > 1e-6)


def _colour_channels(names: dict[str, int], grey: bool, path: Path) -> list[int]:
    colour = [names[name] for name in ("XYZ" if "X" in names and not has_colours(names) else "RGB") if name in names]
    if grey and not colour and len(names.keys() - {"A"}) == 1:
        colour = [next(number for name, number in names.items() if name != "A")] * 3
    if len(colour) != 3:
        raise FormatError(
            f"{path} has {len(names)} channel(s) ({', '.join(names)}) where red, green and blue are needed; "
            "give a colour image"
        )
    return colour


def _seems_premultiplied(values: NDArray[Any], colour: list[int], alpha: F32) -> bool:
    """Whether no stored colour exceeds its alpha at an outline, although the colours there are bright."""
    outline = (alpha > 0) & (alpha < FAINT)
    if np.count_nonzero(outline) < MIN_OUTLINE:
        return False
    brightest, cover = _as_float(values[outline][:, colour]).max(axis=-1), alpha[outline]
    return bool((brightest <= cover + 1 / 255).all() and brightest.mean() > cover.mean() / 4)


def _warn_of_pixel_aspect(path: Path, spec: Any) -> None:
    aspect = image_attribute(spec, "PixelAspectRatio", float)
    if aspect is not None and 0 < aspect < np.inf and abs(np.log(aspect)) > SAME_SIDES:
        log.warning(
            "%s says that its pixels are not square (%.4g:1), and is read as it is stored; convert it to "
            "square pixels, or give a camera file whose focal differs in x and y",
            path,
            aspect,
        )


def _exposure_time(spec: Any) -> float | None:
    seconds = image_attribute(spec, "ExposureTime", float)
    return seconds if seconds is not None and 0 < seconds < np.inf else None


def _read_raw(path: Path, encoding: Encoding, layer: str | None) -> Image:
    if encoding == "srgb":
        raise SettingsError(f"{path} is a camera raw file, which is linear, not sRGB; leave the encoding at auto")
    if layer is not None:
        raise SettingsError(f"{path} is a camera raw file, which has no layer {layer!r}; leave the layer out")
    with silence_libraries():
        image = read_raw(path)
    log.info("read as camera raw: linear, without white balance")
    return image


def read_mask(path: AnyPath) -> Bools:
    """Read a mask: where the alpha channel is above one half if it varies, else where the brightest channel is.

    Integers with only two values, 0 and another, are labels from annotation tools: the other value is the object.

    Returns
    -------
    (H, W) bool array

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is damaged.
    """
    values, names, spec = read_layer(Path(path), None)
    if "A" in names:
        alpha = np.nan_to_num(_as_float(values[..., names.pop("A")]))
        if alpha.min() < alpha.max() or not names:
            return alpha > 0.5
    brightest = values[..., list(names.values())].max(axis=-1)
    label = brightest.max()
    if not is_float(spec) and brightest.min() <= 1 and label > 0 and ((brightest == 0) | (brightest == label)).all():
        return np.asarray(brightest == label)
    return _as_float(brightest) > 0.5


def read_channel(path: AnyPath) -> F32:
    """Read the first channel of an image, (H, W) float32, undecoded. Raises FileError, FormatError."""
    values, names, _ = read_layer(Path(path), None)
    return np.nan_to_num(_as_float(values[..., names.get("R", 0)]))


def read_data(path: AnyPath, layer: str | None = None, *, pair: bool = False) -> tuple[F32, F32 | None]:
    """Read three channels of data (normals), (H, W, 3) float32 without a curve, and alpha or None.

    pair: see :func:`read_image`.
    """
    image = read_image(path, encoding="linear", layer=layer, pair=pair)
    return image.pixels, image.alpha


def read_orientation(path: AnyPath) -> int:
    """EXIF orientation of a photo, 1 to 8, by which :func:`read_image` rotates it; 1, upright, if the file has none.

    Camera raw files return 1: other programs read the output of a raw converter, which is upright.

    Raises FileError if the file is missing, FormatError if it is damaged.
    """
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        existing_file(path, "image")
        return 1
    with closing(open_image(path)) as source:
        return orientation_of(source.spec(), path)


def read_size(path: AnyPath, layer: str | None = None) -> tuple[int, int] | None:
    """Height and width of the result of :func:`read_image`, from the header alone; None for raw files without rawpy.

    Raises FileError if the file is missing, FormatError if it is not an image, SettingsError if it lacks the
    layer.
    """
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        with silence_libraries():
            return raw_size(path)
    with closing(open_image(path)) as source, silence_libraries():
        source.seek_subimage(choose_layer(layers_of(source, path), layer, path).subimage, 0)
        spec = source.spec()
    size = spec.full_height, spec.full_width
    return size if orientation_of(spec, path) < 5 else size[::-1]


def image_description(path: AnyPath) -> str:
    """The description in an image file, "" if it has none or cannot be read as an image.

    Raises FileError if the file's name is not valid UTF-8.
    """
    source = image_input(path)
    if source is None:
        return ""
    with closing(source):
        return image_attribute(source.spec(), "ImageDescription", str) or ""


def _as_float(values: NDArray[Any]) -> F32:
    """Stored values as float32, integers as 0 to 1, NaN for values that count as not finite."""
    if values.dtype.kind != "u":
        return np.where(np.abs(values) <= MAX_VALUE, values, np.float32(np.nan))
    return np.multiply(values, np.float32(1 / np.iinfo(values.dtype).max), dtype=np.float32)
