"""The only door to image files: OpenImageIO in, linear float32 out, and back."""

import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.errors import InputError
from mpsnet_core.files import RAW_SUFFIXES, existing_file, written_whole

log = logging.getLogger(__name__)

Encoding = Literal["auto", "linear", "srgb"]
ENCODINGS: tuple[Encoding, ...] = ("auto", "linear", "srgb")

# Checked before any memory is asked for: a broken or hostile header can claim any size.
MAX_PIXELS = 400_000_000
MAX_CHANNELS = 1024

# Bits a channel that each kind of file can hold; the first is what is written unless asked otherwise.
WRITABLE_BITS = {".png": (16, 8), ".tif": (16, 8, 32), ".tiff": (16, 8, 32), ".exr": (32, 16)}

# Above this share of the clip value a channel counts as saturated: an 8-bit sRGB 254 is linear 0.991.
SATURATED_SHARE = 0.99

# What stands before a PNG's pixels, and is not told otherwise, is within so many bytes.
PNG_HEAD = 65_536
PNG_FILTER_UP = 32  # libpng's number: each pixel is stored as its difference from the one above


@dataclass(frozen=True)
class Image:
    """An image as read.

    pixels: (H, W, 3) float32, linear, row 0 on top, not premultiplied by alpha.
    alpha: (H, W) float32 in 0 to 1, or None where the file has none.
    clip: the linear value from which a channel may be saturated: 1 in integer files, infinity in float files and where
        `clipped` tells it.
    note: how the file's values were taken, for people to read.
    clipped: (H, W, 3) bool, where a channel is at its end and so wrong, or None where `clip` tells it.
    exposure_time: in seconds, where the file says it.
    assumed: whether sRGB is only what most such files hold, and neither the file nor who asked said so.
    """

    pixels: NDArray[np.float32]
    alpha: NDArray[np.float32] | None
    clip: float
    note: str
    clipped: NDArray[np.bool_] | None = None
    exposure_time: float | None = None
    assumed: bool = False

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(H, W, 3) where a channel is at its end, and so wrong."""
        return saturated(self.pixels, self.clip) if self.clipped is None else self.clipped


@dataclass(frozen=True)
class _Layer:
    """Where a layer's channels stand: a subimage (part) of the file and channel numbers by their short names."""

    subimage: int
    channels: dict[str, int]


def saturated(pixels: NDArray[np.float32], clip: float) -> NDArray[np.bool_]:
    """Where values of a photo that clips at `clip` are at their end; of the shape of `pixels`."""
    return pixels >= SATURATED_SHARE * clip


def srgb_to_linear(values: NDArray[Any]) -> NDArray[Any]:
    """The sRGB curve undone (IEC 61966-2-1); any shape, 0 to 1."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(values: NDArray[Any]) -> NDArray[Any]:
    """The sRGB curve (IEC 61966-2-1); any shape, clipped to 0 to 1."""
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)


def image_layers(path: str | os.PathLike[str]) -> list[str]:
    """Names of the layers in a file; "" is the layer whose channels carry no name. Multi-part EXR parts count too."""
    path = existing_file(path, "image")
    source = _open(path)
    try:
        return list(_layers(source, path))
    finally:
        source.close()


def layer_in(path: str | os.PathLike[str], layer: str | None) -> str | None:
    """The layer to read of a file that goes with a photo whose `layer` is taken: the same, where there is a choice."""
    if layer is None or Path(path).suffix.lower() in RAW_SUFFIXES:
        return None
    return layer if len(image_layers(path)) > 1 else None


def read_image(
    path: str | os.PathLike[str], *, encoding: Encoding = "auto", layer: str | None = None, grey: bool = False
) -> Image:
    """Read a colour image; camera raw files too, where rawpy is installed (:mod:`mpsnet_core.raw`).

    encoding: how the file's values are meant. "auto": float files and files that say so are linear, all others sRGB.
        Camera raw is always linear.
    layer: which layer of a multi-layer or multi-part EXR; its full name or its last part ("Combined"). Unless
        given: the unnamed layer, else the only one, else the one called Combined.
    grey: take a file of one channel as well, for all three.

    Raises InputError where the file is missing, broken, too large, not RGB, or the layer is not there or not told.
    """
    if encoding not in ENCODINGS:
        raise InputError(f"encoding {encoding!r} is not known; choose {', '.join(ENCODINGS)}")
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
    alpha = np.clip(values[..., names["A"]], 0, 1) if "A" in names else None
    is_float = spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)
    premultiplied = alpha is not None and not spec.getattribute("oiio:UnassociatedAlpha")
    declared = str(spec.getattribute("oiio:ColorSpace") or "").lower()
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
    pixels = np.empty((*values.shape[:2], 3), np.float32)
    for rows in bands(len(values)):
        band = values[rows][..., colour]
        if alpha is not None and premultiplied:
            cover = alpha[rows, :, None]
            band = np.divide(band, cover, out=np.zeros_like(band), where=cover > 1e-6)
        pixels[rows] = band if linear else srgb_to_linear(band)
    clip = np.inf if is_float else 1.0
    return Image(pixels, alpha, clip, note, exposure_time=_exposure_time(spec), assumed=assumed)


def _says_its_curve(path: Path, spec: Any) -> bool:
    """Whether a file says how its values are meant, as JPEG does; OpenImageIO calls sRGB what says nothing, too."""
    if any(spec.getattribute(name) is not None for name in ("ICCProfile", "CICP", "oiio:Gamma", "Exif:ColorSpace")):
        return True
    if path.suffix.lower() == ".png":
        with path.open("rb") as file:
            return b"sRGB" in file.read(PNG_HEAD).partition(b"IDAT")[0]
    return path.suffix.lower() in (".jpg", ".jpeg")


def _exposure_time(spec: Any) -> float | None:
    seconds = spec.getattribute("ExposureTime")
    return float(seconds) if isinstance(seconds, float) and 0 < seconds < np.inf else None


def _read_raw(path: Path, encoding: Encoding, layer: str | None) -> Image:
    from mpsnet_core.raw import read_raw  # it needs this module

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
        alpha = values[..., names.pop("A")]
        if alpha.min() < alpha.max() or not names:
            return alpha > 0.5
    return values[..., list(names.values())].max(axis=-1) > 0.5


def read_channel(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """Read the first channel of an image as it stands, (H, W) float32. Raises InputError where it cannot be read."""
    values, names, _ = _read_layer(Path(path), None)
    return np.nan_to_num(values[..., names.get("R", 0)])


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
        return int(source.spec().getattribute("Orientation") or 1)
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
    """Write (H, W) or (H, W, C) values as they stand, whole or not at all.

    A fourth channel is alpha, not premultiplied into the others here. bits: 8, 16 or 32 as the format allows; integers
    hold 0 to 1, EXR 16 is half. color_space: "raw" for data, "sRGB" for pictures whose values carry that curve.
    description: a line of text to be kept in the file, which :func:`image_description` reads.

    Raises InputError where the format, the bits or the place to write are not usable.
    """
    path = Path(path)
    bits = checked_bits(path, bits)
    pixels = np.ascontiguousarray(pixels if pixels.ndim == 3 else pixels[..., None], dtype=np.float32)
    height, width, channels = pixels.shape
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

    def stored(band: NDArray[np.float32]) -> NDArray[np.float32]:
        if is_exr and channels == 4:  # OpenEXR defines colour as premultiplied
            return np.concatenate([band[..., :3] * band[..., 3:], band[..., 3:]], axis=-1)
        return band

    with written_whole(path) as unfinished:
        target = oiio.ImageOutput.create(str(unfinished))
        if target is None:
            raise InputError(f"cannot write {path}: {oiio.geterror()}")
        done = target.open(str(unfinished), spec) and all(
            target.write_scanlines(rows.start, rows.stop, 0, stored(pixels[rows])) for rows in bands(height)
        )
        if not (target.close() and done and _has_its_end(unfinished)):
            reason = target.geterror() or oiio.geterror() or "the file was cut short"
            reason = " ".join(reason.replace(str(unfinished), path.name).split())
            raise InputError(f"cannot write {path} ({reason[:80]}); make room on the disk")


def image_description(path: str | os.PathLike[str]) -> str:
    """The line of text that an image file keeps, "" where it has none or cannot be read as an image.

    Raises InputError where the file's name is not valid UTF-8.
    """
    source = _input(path)
    if source is None:
        oiio.geterror()
        return ""
    try:
        return str(source.spec().getattribute("ImageDescription") or "")
    finally:
        source.close()


def _has_its_end(file: Path) -> bool:
    """Whether a PNG has its last chunk: OpenImageIO reports success where a full disk cut it short."""
    if file.suffix.lower() != ".png":
        return True
    with file.open("rb") as written:
        written.seek(-8, os.SEEK_END)
        return written.read(4) == b"IEND"


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
    source = _input(path, config)
    if source is None:
        reason = " ".join(oiio.geterror().split())
        raise InputError(f"{path} cannot be read as an image ({reason}); is it PNG, JPEG, TIFF or EXR, and whole?")
    return source


def _input(path: str | os.PathLike[str], *config: Any) -> Any:
    """OpenImageIO's reader of a file, None where it is no image. Raises InputError where its name cannot be passed."""
    try:
        return oiio.ImageInput.open(os.fspath(path), *config)
    except (TypeError, UnicodeError):
        raise InputError(f"{os.fspath(path)!a} cannot be opened: its name is not valid UTF-8; rename it") from None


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
        part = str(spec.getattribute("oiio:subimagename") or "")
        for number, channel in enumerate(spec.channelnames):
            prefix, _, name = channel.rpartition(".")
            # Blender 5 writes a part a pass and repeats its name in the channels only where a pass has a layer.
            layer = prefix or (part if subimage or not _is_colour(spec.channelnames) else "")
            layers.setdefault(layer, _Layer(subimage, {})).channels.setdefault(_short(name, spec.nchannels), number)
        subimage += 1
    source.geterror()  # seeking past the last part leaves a message behind
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


def _read_layer(path: Path, layer: str | None) -> tuple[NDArray[np.float32], dict[str, int], Any]:
    """All values of a layer (H, W, C) float32 as stored, its channels by short name, and the file's spec."""
    path = existing_file(path, "image")
    source = _open(path)
    try:
        chosen = _choose(_layers(source, path), layer, path)
        source.seek_subimage(chosen.subimage, 0)
        spec = source.spec()
        first, last = min(chosen.channels.values()), max(chosen.channels.values())
        with libraries_silent():
            values = source.read_image(chosen.subimage, 0, first, last + 1, oiio.FLOAT)
        reason = " ".join(source.geterror().split())
    finally:
        source.close()
    if values is None or reason:
        raise InputError(f"{path} is damaged or cut short ({reason or 'no pixels'}); copy or export it again")
    values = np.asarray(values, dtype=np.float32).reshape(spec.height, spec.width, last + 1 - first)
    values = _upright(_on_display_window(values, spec), spec)
    return values, {name: number - first for name, number in chosen.channels.items()}, spec


def _upright(values: NDArray[np.float32], spec: Any) -> NDArray[np.float32]:
    """Pixels as a viewer shows them: cameras store a photo as its sensor lay, and say in EXIF how to turn it."""
    orientation = spec.getattribute("Orientation") or 1
    if orientation >= 5:
        values = values.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values


def _on_display_window(values: NDArray[np.float32], spec: Any) -> NDArray[np.float32]:
    """An EXR may hold only a part of its picture (a render region), or more than it; what is missing is zero."""
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    if (top, left, spec.height, spec.width) == (0, 0, spec.full_height, spec.full_width):
        return values
    whole = np.zeros((spec.full_height, spec.full_width, values.shape[2]), np.float32)
    rows = slice(max(top, 0), min(top + spec.height, spec.full_height))
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    if rows.start < rows.stop and columns.start < columns.stop:
        whole[rows, columns] = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Keep libpng and OpenEXR from printing to stderr what OpenImageIO hands to us as well.

    stderr belongs to the whole process, so of threads that read at the same time only one may turn it aside.
    """
    with _stderr_lock:
        try:
            stderr = os.dup(2)
        except OSError:  # a windowed program has none
            yield
            return
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


_stderr_lock = threading.RLock()
