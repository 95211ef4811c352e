"""Photos, masks and data read from image files."""

import logging
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import FEW_ROWS, bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.errors import FormatError, SettingsError
from mpsnet_core.io.file_kinds import EXPOSURE
from mpsnet_core.io.files import RAW_SUFFIXES, existing_file
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear, storage_type
from mpsnet_core.io.image_encoding import IS_LINEAR, Encoding, curve_of, identity_curve, is_float
from mpsnet_core.io.image_input import image_attribute, image_input, open_image, silence_libraries
from mpsnet_core.io.image_layers import (
    FORMAT,
    PALETTE,
    choose_layer,
    has_colours,
    layers_of,
    orientation_of,
    read_layer,
)
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.raw import raw_size, read_raw

log = logging.getLogger(__name__)

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
    return _decoded(path, values, names, spec, encoding, grey, compact)


def _decoded(
    path: Path,
    values: NDArray[Any],
    names: dict[str, int],
    spec: oiio.ImageSpec,
    encoding: Encoding,
    grey: bool,
    compact: bool,
) -> Image:
    """The image of a file's values (H, W, C), whose channels have these names and places."""
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
            "the colours of %s look multiplied by its alpha, which its format does not allow: edges are too dark; "
            "export it with straight alpha",
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
            "%s says that its pixels are not square (%.4g:1), and is read as it is stored; convert it to square "
            "pixels, or give a camera file whose focal differs in x and y",
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
        alpha = _as_float(values[..., names.pop("A")])
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
