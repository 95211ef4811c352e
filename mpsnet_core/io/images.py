"""Image files, read and written by OpenImageIO: nothing else opens them."""

import logging
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import ROWS, bands
from mpsnet_core.errors import Choices, FileError, FormatError, SettingsError
from mpsnet_core.io.colour_profile import UNKNOWN_TRANSFER, Curve, profile_curve, sampled, transfer_is_linear
from mpsnet_core.io.files import RAW_SUFFIXES, checked_bits, existing_file, temporary_folder, written_whole
from mpsnet_core.io.image import MAX_PIXELS, Image, linear_to_srgb, srgb_to_linear, storage_type
from mpsnet_core.io.raw import read_raw

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)
_Kind = TypeVar("_Kind")

Encoding = Literal["auto", "linear", "srgb"]
# Whether values are linear; None where the file decides.
_IS_LINEAR = Choices[bool | None]("encoding", {"auto": None, "linear": True, "srgb": False})

# The gamma of a PNG that stands for the sRGB curve, and the range of others that a display or a camera may have.
SRGB_GAMMA, OTHER_GAMMAS = 2.2, (1.0, 3.0)
# A colour profile's curve that differs nowhere by more is the sRGB curve, or none: small profiles have coarse tables.
SAME_CURVE = 0.003

# Checked before any memory is allocated: a broken or hostile header can claim any number.
MAX_CHANNELS = 1024
MAX_LAYER_VALUES = 4 * MAX_PIXELS  # of all the channels that are read at once
# Far above the sun's, and its square is finite in float32; larger values count as not finite.
MAX_VALUE = 1e15

# First bytes of the formats that are read, and OpenImageIO's names of these formats.
_SIGNATURES = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"v/1\x01")
_FORMATS = ("png", "jpeg", "tiff", "openexr")

# A PNG's chunks before its pixels are within so many bytes.
PNG_HEAD = 65_536
PNG_FILTER_UP = 32  # libpng's number: each pixel is stored as its difference from the one above


@dataclass(frozen=True)
class _Layer:
    """A layer's channels: a subimage (part) of the file and channel indices by their short names."""

    subimage: int
    channels: dict[str, int]


def image_layers(path: str | os.PathLike[str]) -> list[str]:
    """Names of the layers in a file, "" for channels without a layer's name. Parts of multi-part EXRs count too."""
    path = Path(path)
    with closing(_open(path)) as source, libraries_silent():
        return list(_layers(source, path))


def layer_in(path: str | os.PathLike[str], layer: str | None) -> str | None:
    """The layer to read of a file that belongs to a photo's `layer`: the same, where the file has several."""
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
    """Read a colour image; camera raw files too, where rawpy is installed.

    Parameters
    ----------
    path : path-like
        A PNG, JPEG, TIFF or EXR file, or camera raw, which is always linear.
    encoding : {"auto", "linear", "srgb"}, optional
        Of the file's values. "auto": those with a colour profile (ICC) or a PNG's gamma have its curve, other float
        files and files that state so are linear, all others have the sRGB curve.
    layer : str, optional
        Layer of a multi-layer or multi-part EXR: its full name or the name's last part ("Combined"). By default the
        unnamed layer, else the only one, else the one called Combined.
    grey : bool, optional
        Accept a file of one channel too, for all three.
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
        If the layer is missing or ambiguous, or the encoding unknown.
    """
    requested = _IS_LINEAR[encoding]
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        return _read_raw(path, encoding, layer)
    values, names, spec = _read_layer(path, layer)
    if image_attribute(spec, "tiff:ColorSpace", str) == "CIELAB":
        raise FormatError(f"{path} is in Lab colours, which are no light; export it as RGB")
    colour = _colour_channels(names, grey, path)
    alpha = np.clip(_as_float(values[..., names["A"]]), 0, 1) if "A" in names else None
    if requested is None:
        decoded, assumed = _stated_encoding(path, spec)
    else:
        decoded, assumed = (_as_it_is if requested else srgb_to_linear), False
    premultiplied = alpha is not None and not spec.getattribute("oiio:UnassociatedAlpha")
    fits = compact and spec.format.basetype in (oiio.HALF, oiio.UINT8, oiio.UINT16)
    pixels = np.empty((*values.shape[:2], 3), storage_type(values.shape) if fits else np.float32)
    for rows in bands(len(values)):
        band = _as_float(values[rows][..., colour])
        if alpha is not None and premultiplied:
            cover = alpha[rows, :, None]
            # Without any cover a colour is light alone, as some renderers write every pixel.
            band = np.divide(band, cover, out=band, where=cover > 1e-6)
        pixels[rows] = decoded(band)
    # What another curve makes ends at 1.
    clip = np.inf if _is_float(spec) and decoded in (_as_it_is, srgb_to_linear) else 1.0
    return Image(pixels, alpha, clip, exposure_time=_exposure_time(spec), assumed=assumed)


def _colour_channels(names: dict[str, int], grey: bool, path: Path) -> list[int]:
    colour = [names[name] for name in ("XYZ" if "X" in names and not _is_colour(names) else "RGB") if name in names]
    if grey and not colour and len(names.keys() - {"A"}) == 1:
        colour = [next(number for name, number in names.items() if name != "A")] * 3
    if len(colour) != 3:
        raise FormatError(
            f"{path} has {len(names)} channel(s) ({', '.join(names)}) where red, green and blue are needed; "
            "give a colour image"
        )
    return colour


def _stated_encoding(path: Path, spec: Any) -> tuple[Curve, bool]:
    """The curve of a file's values by what it states, and whether that it is sRGB is only assumed."""
    is_float = _is_float(spec)
    stated = (image_attribute(spec, "oiio:ColorSpace", str) or "").lower()
    profile = image_attribute(spec, "ICCProfile", np.ndarray)
    transfer = _png_transfer(path)
    if transfer is not None:  # it overrides a PNG's profile and gamma
        linear, curve = transfer_is_linear(path, transfer), None
    else:
        linear = "lin" in stated or stated in ("raw", "data")
        curve = None if linear or profile is None else profile_curve(profile.tobytes())
        linear = linear or (is_float and curve is None)
        if curve is None and not linear:
            curve = _gamma_curve(image_attribute(spec, "oiio:Gamma", float))
    assumed = not (linear or curve is not None or transfer is not None or _states_its_curve(path, spec))
    known: tuple[tuple[str, Curve], ...] = (("linear", _as_it_is), ("sRGB", srgb_to_linear))
    name, decoded = known[0] if linear else known[1]
    if curve is not None:
        same = (pair for pair in known if np.abs(sampled(pair[1]) - sampled(curve)).max() < SAME_CURVE)
        name, decoded = next(same, ("the file states", curve))
    hint = ""
    if assumed and spec.format.basetype == oiio.UINT16:
        hint = "; if a raw converter wrote linear values, set the encoding to linear"
    log.info("read as %s (%s file)%s", name, "float" if is_float else spec.format, hint)
    return decoded, assumed


def _gamma_curve(gamma: float | None) -> Curve | None:
    """Of a PNG that states no more than its gamma; None where that stands for the sRGB curve, or is none."""
    if gamma is None or abs(gamma - SRGB_GAMMA) < 0.01 or not OTHER_GAMMAS[0] <= gamma <= OTHER_GAMMAS[1]:
        return None
    return lambda values: np.maximum(values, 0) ** np.float32(gamma)


def _as_it_is(values: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    return values


def as_stored(image: Image) -> Image:
    """An image that was decoded as sRGB, overwritten with the values of its file as linear ones."""
    for rows in bands(len(image.pixels)):
        image.pixels[rows] = linear_to_srgb(image.pixels[rows].astype(np.float32, copy=False))
    return replace(image, assumed=False)


def _states_its_curve(path: Path, spec: Any) -> bool:
    """Whether a file states its encoding otherwise than by a profile, as JPEG does.

    OpenImageIO reports sRGB for files without a statement, too.
    """
    if any(spec.getattribute(name) is not None for name in ("oiio:Gamma", "Exif:ColorSpace")):
        return True
    if path.suffix.lower() == ".png":
        return b"sRGB" in _png_head(path)
    return path.suffix.lower() in (".jpg", ".jpeg")


def _png_transfer(path: Path) -> int | None:
    """The transfer characteristics that a PNG states in its chunk cICP, which OpenImageIO 3.0 passes over."""
    _, found, body = _png_head(path).partition(b"\0\0\0\4cICP")
    return body[1] if found and len(body) > 1 and body[1] != UNKNOWN_TRANSFER else None


def _png_head(path: Path) -> bytes:
    """What stands before a PNG's pixels; nothing of other files."""
    with path.open("rb") as file:
        if file.read(len(_SIGNATURES[0])) != _SIGNATURES[0]:
            return b""
        return file.read(PNG_HEAD).partition(b"IDAT")[0]


def _exposure_time(spec: Any) -> float | None:
    seconds = image_attribute(spec, "ExposureTime", float)
    return seconds if seconds is not None and 0 < seconds < np.inf else None


def _read_raw(path: Path, encoding: Encoding, layer: str | None) -> Image:
    if encoding == "srgb":
        raise SettingsError(f"{path} is a camera raw file, which is linear, not sRGB; leave the encoding at auto")
    if layer is not None:
        raise SettingsError(f"{path} is a camera raw file, which has no layer {layer!r}; leave the layer out")
    with libraries_silent():
        image = read_raw(path)
    log.info("read as camera raw: linear, without white balance")
    return image


def read_mask(path: str | os.PathLike[str]) -> NDArray[np.bool_]:
    """Read a mask: where the alpha channel is above half if it varies, else where the brightest channel is.

    Whole numbers that are 0 and one other alone are labels, as annotation tools write them: the other is the object.

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
    values, names, spec = _read_layer(Path(path), None)
    if "A" in names:
        alpha = _as_float(values[..., names.pop("A")])
        if alpha.min() < alpha.max() or not names:
            return alpha > 0.5
    brightest = values[..., list(names.values())].max(axis=-1)
    label = brightest.max()
    if not _is_float(spec) and brightest.min() <= 1 and label > 0 and ((brightest == 0) | (brightest == label)).all():
        return np.asarray(brightest == label)
    return _as_float(brightest) > 0.5


def read_channel(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Read the first channel of an image, (H, W) float32, undecoded. Raises FileError, FormatError."""
    values, names, _ = _read_layer(Path(path), None)
    return np.nan_to_num(_as_float(values[..., names.get("R", 0)]))


def read_data(
    path: str | os.PathLike[str], layer: str | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Read three channels of data (normals), (H, W, 3) float32 without any curve, and alpha or None."""
    image = read_image(path, encoding="linear", layer=layer)
    return image.pixels, image.alpha


def read_orientation(path: str | os.PathLike[str]) -> int:
    """EXIF orientation of a photo, 1 to 8, by which :func:`read_image` rotates it; 1, upright, if the file has none.

    Camera raw counts as 1: other programs read a raw converter's output, which is upright.

    Raises FileError where the file is missing, FormatError where it is damaged.
    """
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        existing_file(path, "image")
        return 1
    with closing(_open(path)) as source:
        return _orientation(source.spec())


def read_size(path: str | os.PathLike[str], layer: str | None = None) -> tuple[int, int] | None:
    """Height and width of what :func:`read_image` returns, by the file's header alone; None for camera raw.

    Raises FileError where the file is missing, FormatError where it is no image, SettingsError where it lacks the
    layer.
    """
    path = Path(path)
    if path.suffix.lower() in RAW_SUFFIXES:
        existing_file(path, "image")
        return None
    with closing(_open(path)) as source, libraries_silent():
        source.seek_subimage(_choose(_layers(source, path), layer, path).subimage, 0)
        spec = source.spec()
    size = spec.full_height, spec.full_width
    return size if _orientation(spec) < 5 else size[::-1]


def write_image(
    path: str | os.PathLike[str],
    pixels: NDArray[Any],
    *,
    bits: int | None = None,
    color_space: str = "raw",
    description: str | None = None,
) -> None:
    """Write an image without applying a curve, whole or not at all.

    Parameters
    ----------
    path : path-like
        A .png, .tif or .exr file.
    pixels : (H, W) or (H, W, C) array
        Of four channels the last is alpha, not premultiplied.
    bits : int, optional
        8, 16 or 32 per channel as the format allows. Integers store 0 to 1; EXR's 16 are half floats.
    color_space : str, optional
        "raw" for data, "sRGB" for pictures with that curve.
    description : str, optional
        A line of text in the file.

    Raises
    ------
    FileError
        If the file cannot be written.
    SettingsError
        If the format or the bits are not supported.
    """
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
    """Write an image of `shape` (H, W, C) that is computed as it is written, whole or not at all.

    band: returns the values (h, W, C) of some rows, from the top to the bottom. All else as of :func:`write_image`.
    """
    _write(Path(path), written_whole(path), shape, band, bits, color_space, description)


def png_bytes(pixels: NDArray[Any]) -> bytes:
    """A picture (H, W, 3) of sRGB values as a PNG file of 8 bits. Raises FileError where the disk is full."""
    height, width, channels = pixels.shape
    with temporary_folder() as folder:
        file = folder / "picture.png"
        _write(file, nullcontext(file), (height, width, channels), lambda rows: pixels[rows], 8, "sRGB", None)
        return file.read_bytes()


def _write(
    path: Path,
    place: AbstractContextManager[Path],
    shape: tuple[int, int, int],
    band: Callable[[slice], NDArray[Any]],
    bits: int | None,
    color_space: str,
    description: str | None,
) -> None:
    """Write the image `path` into the file that `place` yields."""
    height, _, channels = shape
    premultiplied = path.suffix.lower() == ".exr" and channels == 4  # as OpenEXR defines colour
    spec = _output_spec(path, shape, bits)
    spec.attribute("oiio:ColorSpace", color_space)
    if description is not None:
        spec.attribute("ImageDescription", description)
    with place as file:
        target = oiio.ImageOutput.create(str(file))
        if target is None:
            raise FileError(f"cannot write {path}: {complaint(oiio)}")
        try:
            done = target.open(str(file), spec)
            for top in range(0, height, ROWS) if done else ():
                bottom = min(top + ROWS, height)
                values = np.ascontiguousarray(band(slice(top, bottom)), dtype=np.float32)
                if premultiplied:
                    values = np.concatenate([values[..., :3] * values[..., 3:], values[..., 3:]], axis=-1)
                done = target.write_scanlines(top, bottom, 0, values)
                if not done:
                    break
        finally:
            with libraries_silent():  # libpng reports a picture that is not whole
                closed = target.close()
        # OpenImageIO reports success where a full disk cut a file short.
        if not (closed and done and is_whole(file)):
            reason = complaint(target) or complaint(oiio) or "the file was cut short"
            reason = reason.replace(str(file), path.name)
            raise FileError(f"cannot write {path} ({reason[:80]}); make room on the disk")


def _output_spec(path: Path, shape: tuple[int, int, int], bits: int | None) -> Any:
    height, width, channels = shape
    bits, suffix = checked_bits(path, bits), path.suffix.lower()
    is_exr = suffix == ".exr"
    kind = ("half" if bits == 16 else "float") if is_exr else {8: "uint8", 16: "uint16", 32: "float"}[bits]
    spec = oiio.ImageSpec(width, height, channels, kind)
    if suffix == ".png":
        # For 16 bits of normals or photos, smaller files than libpng's defaults in a quarter of the time.
        spec.attribute("compression", "rle")
        spec.attribute("png:filter", PNG_FILTER_UP)
    else:
        spec.attribute("compression", "zip")
    if channels == 4:
        spec.alpha_channel = 3
        if not is_exr:
            spec.attribute("oiio:UnassociatedAlpha", 1)
    return spec


def image_description(path: str | os.PathLike[str]) -> str:
    """The description in an image file, "" where it has none or cannot be read as an image.

    Raises FileError where the file's name is not valid UTF-8.
    """
    source = image_input(path)
    if source is None:
        complaint(oiio)
        return ""
    with closing(source):
        return image_attribute(source.spec(), "ImageDescription", str) or ""


def is_whole(path: str | os.PathLike[str]) -> bool:
    """Whether an image file of ours exists and is not cut short.

    Fast enough for folders of thousands: a PNG ends in a marker, and of other formats only the last rows are read.
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        with suppress(OSError), path.open("rb") as file:
            file.seek(-8, os.SEEK_END)
            return file.read(4) == b"IEND"
        return False
    with libraries_silent():
        source = image_input(path)
        if source is None:
            complaint(oiio)
            return False
        with closing(source):
            spec = source.spec()
            strip = max(image_attribute(spec, "tiff:RowsPerStrip", int) or 1, 1)  # strips are decoded whole
            first = (spec.height - 1) // strip * strip
            last = source.read_scanlines(first, spec.height, 0, 0, spec.nchannels, spec.format)
            return last is not None and not complaint(source)


def _open(path: Path) -> Any:
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = image_input(path, config)
    if source is None:
        existing_file(path, "image")
        reason = complaint(oiio) or "it is a file of another kind"
        raise FormatError(f"{path} cannot be read as an image ({reason}); is it PNG, JPEG, TIFF or EXR, and whole?")
    return source


def image_input(path: str | os.PathLike[str], *config: Any) -> Any:
    """OpenImageIO's reader of a PNG, JPEG, TIFF or EXR file, whatever its suffix; None where it is none of them.

    Files of OpenImageIO's other formats are not opened. :func:`complaint` may return the reason.

    Raises FileError where the file's name is not valid UTF-8.
    """
    try:
        with Path(path).open("rb") as file:
            known = file.read(8).startswith(_SIGNATURES)
        if not known:
            return None
        with libraries_silent():
            source = oiio.ImageInput.open(os.fspath(path), *config)
    except (OSError, UnicodeEncodeError):
        return None
    except TypeError:  # OpenImageIO's
        raise FileError(f"{path} cannot be opened: its name is not valid UTF-8; rename it") from None
    if source is not None and source.format_name() not in _FORMATS:
        source.close()
        return None
    return source


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Keep libpng and OpenEXR from printing to stderr what OpenImageIO returns as well.

    stderr belongs to the whole process, so only one thread at a time may redirect it.
    """
    with _stderr_lock:
        try:
            stderr = os.dup(2)
        except OSError:  # a windowed program has none
            yield
            return
        with Path(os.devnull).open("wb") as null:
            os.dup2(null.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


_stderr_lock = threading.RLock()


def complaint(source: Any) -> str:
    """The pending error message of OpenImageIO, or of its reader or writer, as one line; clears it."""
    try:
        return " ".join(source.geterror().split())
    except UnicodeDecodeError:  # it quotes the file
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
            raise FormatError(
                f"{path} claims to be {spec.width} x {spec.height} with {spec.nchannels} channels, more than this "
                f"program reads ({MAX_PIXELS // 10**6} megapixels, {MAX_CHANNELS} channels, no volumes)"
            )
        part = image_attribute(spec, "oiio:subimagename", str) or ""
        names = _channel_names(spec, path)
        for number, channel in enumerate(names):
            prefix, _, name = channel.rpartition(".")
            # Blender 5 writes a part per pass and repeats its name in the channels only where a pass has a layer.
            layer = prefix or (part if subimage or not _is_colour(names) else "")
            found = layers.setdefault(layer, _Layer(subimage, {}))
            if found.subimage == subimage:  # further pages of a TIFF have no name, and are not read
                found.channels.setdefault(_short(name, spec.nchannels), number)
        subimage += 1
    complaint(source)  # of seeking past the last part
    return layers


def _channel_names(spec: Any, path: Path) -> tuple[str, ...]:
    try:
        names: tuple[str, ...] = spec.channelnames
        "".join(names).encode()  # OpenImageIO 3.1 hands out what it cannot decode
    except UnicodeError:
        raise FormatError(
            f"{path} names a channel or layer in letters that are not UTF-8; rename it and export it again"
        ) from None
    return names


def _is_colour(names: Iterable[str]) -> bool:
    return {"R", "G", "B"}.issubset(names)


def _short(name: str, count: int) -> str:
    """A file's channel name as R, G, B, A, X, Y or Z, if it is one of these."""
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
        raise SettingsError(f"{path} has no layer {wanted!r}; it has {names}")
    raise SettingsError(f"{path} has several layers; name one of {names}")


def _read_layer(path: Path, layer: str | None) -> tuple[NDArray[Any], dict[str, int], Any]:
    """All values of a layer (H, W, C) as stored, its channel indices by short name, and the file's spec.

    Integers of 8 and 16 bits stay integers (see :func:`_as_float`), all else is float32.
    """
    with closing(_open(path)) as source, libraries_silent():
        reason = complaint(source)  # progressive JPEGs are decoded as they are opened
        is_whole_picture = source.format_name() == "png"  # its offset says where on a page it was
        chosen = _choose(_layers(source, path), layer, path)
        source.seek_subimage(chosen.subimage, 0)
        spec = source.spec()
        first, last = min(chosen.channels.values()), max(chosen.channels.values())
        if spec.width * spec.height * (last + 1 - first) > MAX_LAYER_VALUES:
            raise FormatError(
                f"{path} has {last + 1 - first} channels in a layer of {spec.width} x {spec.height}, more than this "
                "program reads; export the photo alone"
            )
        kind = spec.format.basetype if spec.format.basetype in (oiio.UINT8, oiio.UINT16) else oiio.FLOAT
        values = source.read_image(chosen.subimage, 0, first, last + 1, kind)
        reason = reason or complaint(source)
    if values is None or reason:
        raise FormatError(f"{path} is damaged or cut short ({reason or 'no pixels'}); copy or export it again")
    values = np.asarray(values).reshape(spec.height, spec.width, last + 1 - first)
    if not is_whole_picture:
        values = _on_display_window(values, spec)
    values = _upright(values, spec)
    return values, {name: number - first for name, number in chosen.channels.items()}, spec


def _as_float(values: NDArray[Any]) -> NDArray[np.float32]:
    """Stored values as float32, integers as 0 to 1, NaN for what counts as not finite."""
    if values.dtype.kind != "u":
        return np.where(np.abs(values) <= MAX_VALUE, values, np.float32(np.nan))
    scaled: NDArray[np.float32] = np.multiply(values, np.float32(1 / np.iinfo(values.dtype).max), dtype=np.float32)
    return scaled


def _is_float(spec: Any) -> bool:
    return spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _upright(values: NDArray[T], spec: Any) -> NDArray[T]:
    """Pixels rotated by the file's EXIF orientation, as viewers display them."""
    orientation = _orientation(spec)
    if orientation >= 5:
        values = values.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values


def _orientation(spec: Any) -> int:
    """EXIF orientation, 1 where the file has none."""
    orientation = image_attribute(spec, "Orientation", int) or 1
    return orientation if 1 <= orientation <= 8 else 1


def _on_display_window(values: NDArray[T], spec: Any) -> NDArray[T]:
    """An EXR's data window may be smaller (a render region) or larger than its display window; fills with zero."""
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if (top, left, spec.height, spec.width) == (0, 0, spec.full_height, spec.full_width):
        return values
    whole = np.zeros((spec.full_height, spec.full_width, values.shape[2]), values.dtype)
    rows = slice(max(top, 0), min(top + spec.height, spec.full_height))
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    if rows.start < rows.stop and columns.start < columns.stop:
        whole[rows, columns] = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole
