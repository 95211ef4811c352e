"""The only door to image files: OpenImageIO in, linear float32 out, and back."""

import contextlib
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.errors import InputError, check_choice
from mpsnet_core.io.files import RAW_SUFFIXES, existing_file, is_utf8, temporary_folder, written_whole
from mpsnet_core.io.image import MAX_PIXELS, Image, libraries_silent, linear_to_srgb, srgb_to_linear, storage_type
from mpsnet_core.io.raw import read_raw

log = logging.getLogger(__name__)

_Kind = TypeVar("_Kind")

Encoding = Literal["auto", "linear", "srgb"]
ENCODINGS: tuple[Encoding, ...] = ("auto", "linear", "srgb")

# Checked before any memory is asked for: a broken or hostile header can claim any number.
MAX_CHANNELS = 1024
# Far above the sun's, and its square is a float32 still; what is beyond counts as not finite.
MAX_VALUE = 1e15

# Bits a channel that each kind of file can hold; the first is what is written unless asked otherwise.
WRITABLE_BITS = {".png": (16, 8), ".tif": (16, 8, 32), ".tiff": (16, 8, 32), ".exr": (32, 16)}

# What files of the formats that are read begin with, and what OpenImageIO calls these.
_SIGNATURES = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"v/1\x01")
_FORMATS = ("png", "jpeg", "tiff", "openexr")

# What stands before a PNG's pixels, and is not told otherwise, is within so many bytes.
PNG_HEAD = 65_536
PNG_FILTER_UP = 32  # libpng's number: each pixel is stored as its difference from the one above


@dataclass(frozen=True)
class _Layer:
    """Where a layer's channels stand: a subimage (part) of the file and channel numbers by their short names."""

    subimage: int
    channels: dict[str, int]


def image_layers(path: str | os.PathLike[str]) -> list[str]:
    """Names of the layers in a file; "" is the layer whose channels carry no name. Multi-part EXR parts count too."""
    path = existing_file(path, "image")
    source = _open(path)
    try:
        with libraries_silent():
            return list(_layers(source, path))
    finally:
        source.close()


def layer_in(path: str | os.PathLike[str], layer: str | None) -> str | None:
    """The layer to read of a file that goes with a photo whose `layer` is taken: the same, where there is a choice."""
    if layer is None or Path(path).suffix.lower() in RAW_SUFFIXES:
        return None
    return layer if len(image_layers(path)) > 1 else None


def read_image(
    path: str | os.PathLike[str],
    *,
    encoding: Encoding = "auto",
    layer: str | None = None,
    grey: bool = False,
    compact: bool = False,
) -> Image:
    """Read a colour image; camera raw files too, where rawpy is installed (:mod:`mpsnet_core.io.raw`).

    encoding: how the file's values are meant. "auto": float files and files that say so are linear, all others sRGB.
        Camera raw is always linear.
    layer: which layer of a multi-layer or multi-part EXR; its full name or its last part ("Combined"). Unless
        given: the unnamed layer, else the only one, else the one called Combined.
    grey: take a file of one channel as well, for all three.
    compact: hold a large photo in half floats, where its file has no more than 16 bits a channel.

    Raises InputError where the file is missing, broken, too large, not RGB, or the layer is not there or not told.
    """
    check_choice("encoding", encoding, ENCODINGS)
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        return _read_raw(path, encoding, layer)
    values, names, spec = _read_layer(path, layer)
    colour = [names[name] for name in ("XYZ" if "X" in names else "RGB") if name in names]
    if grey and not colour and len(names.keys() - {"A"}) == 1:
        colour = [next(number for name, number in names.items() if name != "A")] * 3
    if len(colour) != 3:
        raise InputError(
            f"{path} has {len(names)} channel(s) ({', '.join(names)}) where red, green and blue are needed; "
            "give a colour image"
        )
    alpha = np.clip(_as_float(values[..., names["A"]]), 0, 1) if "A" in names else None
    is_float = _is_float(spec)
    premultiplied = alpha is not None and not spec.getattribute("oiio:UnassociatedAlpha")
    declared = (image_attribute(spec, "oiio:ColorSpace", str) or "").lower()
    if encoding == "auto":
        linear = is_float or "lin" in declared or declared in ("raw", "data")
        note = f"taken as {'linear' if linear else 'sRGB'} ({'float' if is_float else spec.format} file)"
        assumed = not (linear or _says_its_curve(path, spec))
        if not linear and spec.format.basetype == oiio.UINT16:
            note += "; if a raw converter wrote linear values, set the encoding to linear"
        log.info(note)
    else:
        linear, assumed = encoding == "linear", False
        note = f"taken as {'linear' if linear else 'sRGB'} as told"
    fits = compact and spec.format.basetype in (oiio.HALF, oiio.UINT8, oiio.UINT16)
    pixels = np.empty((*values.shape[:2], 3), storage_type(values.shape) if fits else np.float32)
    for rows in bands(len(values)):
        band = _as_float(values[rows][..., colour])
        if alpha is not None and premultiplied:
            cover = alpha[rows, :, None]
            band = np.divide(band, cover, out=np.zeros_like(band), where=cover > 1e-6)
        pixels[rows] = band if linear else srgb_to_linear(band)
    clip = np.inf if is_float else 1.0
    return Image(pixels, alpha, clip, note, exposure_time=_exposure_time(spec), assumed=assumed)


def as_stored(image: Image) -> Image:
    """An image that was taken as sRGB with the values that its file holds, as linear ones, in place of its own."""
    for rows in bands(len(image.pixels)):
        image.pixels[rows] = linear_to_srgb(image.pixels[rows].astype(np.float32, copy=False))
    return replace(image, note="taken as linear", assumed=False)


def _says_its_curve(path: Path, spec: Any) -> bool:
    """Whether a file says how its values are meant, as JPEG does; OpenImageIO calls sRGB what says nothing, too."""
    if any(spec.getattribute(name) is not None for name in ("ICCProfile", "CICP", "oiio:Gamma", "Exif:ColorSpace")):
        return True
    if path.suffix.lower() == ".png":
        with path.open("rb") as file:
            return b"sRGB" in file.read(PNG_HEAD).partition(b"IDAT")[0]
    return path.suffix.lower() in (".jpg", ".jpeg")


def _exposure_time(spec: Any) -> float | None:
    seconds = image_attribute(spec, "ExposureTime", float)
    return seconds if seconds is not None and 0 < seconds < np.inf else None


def _read_raw(path: Path, encoding: Encoding, layer: str | None) -> Image:
    if encoding == "srgb":
        raise InputError(f"{path} is a camera raw file, which is linear, not sRGB; leave the encoding at auto")
    if layer is not None:
        raise InputError(f"{path} is a camera raw file, which has no layer {layer!r}; leave the layer out")
    image = read_raw(path)
    log.info(image.note)
    return image


def read_mask(path: str | os.PathLike[str]) -> NDArray[np.bool_]:
    """Read a mask, (H, W) bool: the alpha channel where it varies, else where the brightest channel is above half.

    Raises InputError where the file is missing or broken.
    """
    values, names, _ = _read_layer(Path(path), None)
    if "A" in names:
        alpha = _as_float(values[..., names.pop("A")])
        if alpha.min() < alpha.max() or not names:
            return alpha > 0.5
    return _as_float(values[..., list(names.values())].max(axis=-1)) > 0.5


def read_channel(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Read the first channel of an image as it stands, (H, W) float32. Raises InputError where it cannot be read."""
    values, names, _ = _read_layer(Path(path), None)
    return np.nan_to_num(_as_float(values[..., names.get("R", 0)]))


def read_data(
    path: str | os.PathLike[str], layer: str | None = None
) -> tuple[NDArray[np.float32], NDArray[Any] | None]:
    """Read three channels of data (normals) as they stand: (H, W, 3) float32 without any curve, and alpha or None."""
    image = read_image(path, encoding="linear", layer=layer)
    return image.pixels, image.alpha


def read_orientation(path: str | os.PathLike[str]) -> int:
    """EXIF orientation of a photo, 1 to 8; :func:`read_image` turns it so that it is 1, which it is unless told.

    Camera raw counts as 1: other programs see what a raw converter made of it, which is upright.

    Raises InputError where the file is missing or broken.
    """
    path = existing_file(path, "image")
    if path.suffix.lower() in RAW_SUFFIXES:
        return 1
    source = _open(path)
    try:
        return _orientation(source.spec())
    finally:
        source.close()


def write_image(
    path: str | os.PathLike[str],
    pixels: NDArray[Any],
    *,
    bits: int | None = None,
    color_space: str = "raw",
    description: str | None = None,
) -> None:
    """Write (H, W) or (H, W, C) values as they stand, whole or not at all; all else as of :func:`write_bands`."""
    pixels = pixels if pixels.ndim == 3 else pixels[..., None]
    height, width, channels = pixels.shape
    write_bands(
        path,
        (height, width, channels),
        lambda rows: pixels[rows],
        bits=bits,
        color_space=color_space,
        description=description,
    )


def write_bands(
    path: str | os.PathLike[str],
    shape: tuple[int, int, int],
    band: Callable[[slice], NDArray[Any]],
    *,
    bits: int | None = None,
    color_space: str = "raw",
    description: str | None = None,
) -> None:
    """Write an image whose values are made as they are written, whole or not at all.

    shape: (H, W, C). band: gives the values (h, W, C) of some rows, from the top to the bottom; a fourth channel is
        alpha, not premultiplied into the others here.
    bits: 8, 16 or 32 as the format allows; integers hold 0 to 1, EXR 16 is half.
    color_space: "raw" for data, "sRGB" for pictures whose values carry that curve.
    description: a line of text to be kept in the file, which :func:`image_description` reads.

    Raises InputError where the format, the bits or the place to write are not usable.
    """
    path = Path(path)
    bits = checked_bits(path, bits)
    with written_whole(path) as unfinished:
        _write(unfinished, path, shape, band, bits, color_space, description)


def png_bytes(pixels: NDArray[Any]) -> bytes:
    """A picture (H, W, 3) of sRGB values as a PNG file of 8 bits. Raises InputError where the disk is full."""
    height, width, channels = pixels.shape
    with temporary_folder() as folder:
        file = folder / "picture.png"
        _write(file, file, (height, width, channels), lambda rows: pixels[rows], 8, "sRGB", None)
        return file.read_bytes()


def _write(
    file: Path,
    path: Path,
    shape: tuple[int, int, int],
    band: Callable[[slice], NDArray[Any]],
    bits: int,
    color_space: str,
    description: str | None,
) -> None:
    """Write what is to become `path` into `file`."""
    height, width, channels = shape
    is_exr = path.suffix.lower() == ".exr"
    kind = ("half" if bits == 16 else "float") if is_exr else {8: "uint8", 16: "uint16", 32: "float"}[bits]
    spec = oiio.ImageSpec(width, height, channels, kind)
    spec.attribute("oiio:ColorSpace", color_space)
    if path.suffix.lower() == ".png":
        # For 16 bits of normals or photos smaller than what libpng chooses, in a quarter of its time.
        spec.attribute("compression", "rle")
        spec.attribute("png:filter", PNG_FILTER_UP)
    elif not path.suffix.lower().startswith(".jp"):
        spec.attribute("compression", "zip")
    if description is not None:
        spec.attribute("ImageDescription", description)
    if channels == 4:
        spec.alpha_channel = 3
        if not is_exr:
            spec.attribute("oiio:UnassociatedAlpha", 1)

    def stored(rows: slice) -> NDArray[np.float32]:
        values = np.ascontiguousarray(band(rows), dtype=np.float32)
        if is_exr and channels == 4:  # OpenEXR defines colour as premultiplied
            return np.concatenate([values[..., :3] * values[..., 3:], values[..., 3:]], axis=-1)
        return values

    target = oiio.ImageOutput.create(str(file))
    if target is None:
        raise InputError(f"cannot write {path}: {complaint(oiio)}")
    try:
        done = target.open(str(file), spec) and all(
            target.write_scanlines(rows.start, rows.stop, 0, stored(rows)) for rows in bands(height)
        )
    finally:
        with libraries_silent():  # libpng complains of a picture that is not whole
            closed = target.close()
    # OpenImageIO reports success where a full disk cut a file short.
    if not (closed and done and is_whole(file)):
        reason = complaint(target) or complaint(oiio) or "the file was cut short"
        reason = reason.replace(str(file), path.name)
        raise InputError(f"cannot write {path} ({reason[:80]}); make room on the disk")


def image_description(path: str | os.PathLike[str]) -> str:
    """The line of text that an image file keeps, "" where it has none or cannot be read as an image.

    Raises InputError where the file's name is not valid UTF-8.
    """
    source = image_input(path)
    if source is None:
        complaint(oiio)
        return ""
    try:
        return image_attribute(source.spec(), "ImageDescription", str) or ""
    finally:
        source.close()


def is_whole(path: str | os.PathLike[str]) -> bool:
    """Whether an image file of ours is there to its end, which one that was cut short lacks.

    Told in milliseconds, for folders of thousands: a PNG ends in a mark, and of other formats the last rows are read.
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        with contextlib.suppress(OSError), path.open("rb") as file:
            file.seek(-8, os.SEEK_END)
            return file.read(4) == b"IEND"
        return False
    with libraries_silent():
        source = image_input(path)
        if source is None:
            complaint(oiio)
            return False
        try:
            spec = source.spec()
            together = max(
                image_attribute(spec, "tiff:RowsPerStrip", int) or 1, 1
            )  # from within a strip all before it would be read
            first = (spec.height - 1) // together * together
            last = source.read_scanlines(first, spec.height, 0, 0, spec.nchannels, spec.format)
            return last is not None and not complaint(source)
        finally:
            source.close()


def checked_bits(path: Path, bits: int | None = None) -> int:
    """Bits a channel to write `path` with: `bits` if its format can hold them, the format's usual ones if None.

    Raises InputError where the format is not ours or cannot hold them.
    """
    choices = WRITABLE_BITS.get(path.suffix.lower())
    if choices is None:
        kind = path.suffix or "no suffix"
        raise InputError(f"cannot write {path}: {kind} is not an image format of ours; use {', '.join(WRITABLE_BITS)}")
    if bits is None:
        return choices[0]
    if bits not in choices:
        allowed = " or ".join(map(str, sorted(choices)))
        held = f"{path.suffix} files hold {allowed} bits a channel, not {bits}"
        raise InputError(f"cannot write {path}: {held}; change the format or the bits")
    return bits


def _open(path: Path) -> Any:
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = image_input(path, config)
    if source is None:
        reason = complaint(oiio) or "it is a file of another kind"
        raise InputError(f"{path} cannot be read as an image ({reason}); is it PNG, JPEG, TIFF or EXR, and whole?")
    return source


def image_input(path: str | os.PathLike[str], *config: Any) -> Any:
    """OpenImageIO's reader of a PNG, JPEG, TIFF or EXR file, whatever its name ends in; None where it is none of them.

    Nothing else reaches OpenImageIO, which reads twenty formats more. Why not, :func:`complaint` may tell.

    Raises InputError where the file's name is not valid UTF-8.
    """
    if not is_utf8(path):
        raise InputError(f"{path} cannot be opened: its name is not valid UTF-8; rename it")
    try:
        with Path(path).open("rb") as file:
            known = file.read(8).startswith(_SIGNATURES)
    except OSError:
        known = False
    if not known:
        return None
    with libraries_silent():
        source = oiio.ImageInput.open(os.fspath(path), *config)
    if source is not None and source.format_name() not in _FORMATS:
        source.close()
        return None
    return source


def complaint(source: Any) -> str:
    """What OpenImageIO, or its reader or writer of a file, has to complain of, as one line; it forgets it thereby."""
    try:
        return " ".join(source.geterror().split())
    except UnicodeDecodeError:  # it cites the file
        return "a text in it is not UTF-8"


def image_attribute(spec: Any, name: str, kind: type[_Kind]) -> _Kind | None:
    """An attribute of a file, None where it has none of this kind."""
    value = spec.getattribute(name)
    return value if isinstance(value, kind) else None


def _layers(source: Any, path: Path) -> dict[str, _Layer]:
    layers: dict[str, _Layer] = {}
    subimage = 0
    while source.seek_subimage(subimage, 0):
        spec = source.spec()
        if (
            max(spec.width * spec.height, spec.full_width * spec.full_height) > MAX_PIXELS
            or spec.nchannels > MAX_CHANNELS
            or spec.depth > 1
        ):
            raise InputError(
                f"{path} says it is {spec.width} x {spec.height} with {spec.nchannels} channels, more than this "
                f"program reads ({MAX_PIXELS // 10**6} megapixels, {MAX_CHANNELS} channels, no volumes)"
            )
        part = image_attribute(spec, "oiio:subimagename", str) or ""
        names = spec.channelnames
        for number, channel in enumerate(names):
            prefix, _, name = channel.rpartition(".")
            # Blender 5 writes a part a pass and repeats its name in the channels only where a pass has a layer.
            layer = prefix or (part if subimage or not _is_colour(names) else "")
            layers.setdefault(layer, _Layer(subimage, {})).channels.setdefault(_short(name, spec.nchannels), number)
        subimage += 1
    complaint(source)  # seeking past the last part leaves a message behind
    return layers


def _is_colour(names: tuple[str, ...]) -> bool:
    return {"R", "G", "B"} <= set(names)


def _short(name: str, count: int) -> str:
    """Channel names as files spell them, brought to R, G, B, A, X, Y, Z."""
    if count > 1 and name.lower() in ("red", "green", "blue", "alpha"):
        return name[0].upper()
    return name.upper() if len(name) == 1 else name


def _choose(layers: dict[str, _Layer], wanted: str | None, path: Path) -> _Layer:
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
        raise InputError(f"{path} has no layer {wanted!r}; it has {names}")
    raise InputError(f"{path} has several layers; name one of {names}")


def _read_layer(path: Path, layer: str | None) -> tuple[NDArray[Any], dict[str, int], Any]:
    """All values of a layer (H, W, C) as stored, its channels by short name, and the file's spec.

    Integers of 8 and 16 bits stay integers (see :func:`_as_float`), all else is float32.
    """
    path = existing_file(path, "image")
    source = _open(path)
    try:
        with libraries_silent():
            chosen = _choose(_layers(source, path), layer, path)
        source.seek_subimage(chosen.subimage, 0)
        spec = source.spec()
        first, last = min(chosen.channels.values()), max(chosen.channels.values())
        with libraries_silent():
            kind = spec.format.basetype if spec.format.basetype in (oiio.UINT8, oiio.UINT16) else oiio.FLOAT
            values = source.read_image(chosen.subimage, 0, first, last + 1, kind)
        reason = complaint(source)
    finally:
        source.close()
    if values is None or reason:
        raise InputError(f"{path} is damaged or cut short ({reason or 'no pixels'}); copy or export it again")
    values = np.asarray(values).reshape(spec.height, spec.width, last + 1 - first)
    if _is_float(spec):
        for rows in bands(len(values)):
            band = values[rows]
            band[~(np.abs(band) <= MAX_VALUE)] = np.nan
    values = _upright(_on_display_window(values, spec), spec)
    return values, {name: number - first for name, number in chosen.channels.items()}, spec


def _as_float(values: NDArray[Any]) -> NDArray[np.float32]:
    """Stored values as float32, integers as 0 to 1."""
    if values.dtype.kind != "u":
        return values
    return np.multiply(values, np.float32(1 / np.iinfo(values.dtype).max), dtype=np.float32)


def _is_float(spec: Any) -> bool:
    return spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _upright(values: NDArray[Any], spec: Any) -> NDArray[Any]:
    """Pixels as a viewer shows them: cameras store a photo as its sensor lay, and say in EXIF how to turn it."""
    orientation = _orientation(spec)
    if orientation >= 5:
        values = values.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values


def _orientation(spec: Any) -> int:
    """1, upright, unless the file says one of the other numbers of EXIF."""
    orientation = image_attribute(spec, "Orientation", int) or 1
    return orientation if 1 <= orientation <= 8 else 1


def _on_display_window(values: NDArray[Any], spec: Any) -> NDArray[Any]:
    """An EXR may hold only a part of its picture (a render region), or more than it; what is missing is zero."""
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if (top, left, spec.height, spec.width) == (0, 0, spec.full_height, spec.full_width):
        return values
    whole = np.zeros((spec.full_height, spec.full_width, values.shape[2]), values.dtype)
    rows = slice(max(top, 0), min(top + spec.height, spec.full_height))
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    if rows.start < rows.stop and columns.start < columns.stop:
        whole[rows, columns] = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole
