"""Camera raw files, read with LibRaw (rawpy) as the sensor measured them: linear, in the camera's own colours."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import Bools
from mpsnet_core.errors import FileError, FormatError, InputError
from mpsnet_core.io.file_kinds import is_in_jpeg_xl
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.image import MAX_PIXELS, SATURATED_SHARE, Image, oriented

# The EXIF orientation of each of LibRaw's codes: 2 reverses the rows, 1 the columns, and then 4 transposes.
_ORIENTATIONS = (1, 2, 4, 3, 5, 8, 6, 7)


def read_raw(path: Path) -> Image:
    """Read a camera raw file: black level subtracted, 1 where the sensor clips, rotated by its orientation.

    Neither white balance nor a colour matrix or curve is applied. Demosaicing is bilinear, each channel from its own
    sites alone. Other methods assume that channels correlate, as under white light. Here each channel shows another
    light, and they would mix the shading of one light into another's (as LibRaw's AHD and DCB do). The price is colour
    fringes, one pixel wide, at sharp edges of paint.

    `clipped` marks a channel where its site, or a neighbour that it is interpolated from, is saturated.

    Raises FileError if the file is missing; FormatError if it is damaged, too large, or of a sensor without red,
    green and blue in upright rows; InputError if rawpy is not installed.
    """
    try:
        rawpy = importlib.import_module("rawpy")
    except ModuleNotFoundError:
        raise InputError(
            f"{existing_file(path, 'image')} is a camera raw file, which needs rawpy: pip install '.[raw]' in a copy "
            "of the repository, or convert it to a linear TIFF and set the encoding to linear (--encoding linear)"
        ) from None
    with _opened(path, rawpy) as raw:
        raw.unpack()
        return _developed(raw, rawpy, path)


def raw_size(path: Path) -> tuple[int, int] | None:
    """Height and width of the result of :func:`read_raw`, from the header alone; None if rawpy is not installed.

    Raises as :func:`read_raw`.
    """
    try:
        rawpy = importlib.import_module("rawpy")
    except ModuleNotFoundError:
        existing_file(path, "image")
        return None
    with _opened(path, rawpy) as raw:
        sizes = raw.sizes
        rows, columns = _crop(sizes)
        size = len(range(sizes.height)[rows]), len(range(sizes.width)[columns])
        return size[::-1] if sizes.flip & 4 else size


@contextmanager
def _opened(path: Path, rawpy: Any) -> Iterator[Any]:
    """The file, opened and checked. LibRaw's errors in the with block become FormatErrors."""
    path = existing_file(path, "image")
    try:
        with rawpy.RawPy() as raw:
            raw.open_file(str(path))
            _check(raw, path)
            yield raw
    except (rawpy.LibRawError, rawpy.NotSupportedError, NotImplementedError) as error:
        message = error.args[0] if error.args else ""
        reason = message.decode("ascii", "replace") if isinstance(message, bytes) else str(message)
        if is_in_jpeg_xl(path):
            raise FormatError(
                f"{path} is compressed as JPEG XL, as Apple's ProRAW is, which LibRaw does not read; choose another "
                "compression in the camera (ProRAW: Most Compatible), or convert it with Adobe's DNG Converter"
            ) from None
        raise FormatError(
            f"{path} cannot be read as camera raw ({reason}); if it is whole, convert it to a linear TIFF and set "
            "the encoding to linear (--encoding linear)"
        ) from None
    except UnicodeError:
        raise FileError(f"{path} cannot be opened: its name is not valid UTF-8; rename it") from None


def _check(raw: Any, path: Path) -> None:
    """Check the header, before any memory is allocated."""
    sizes = raw.sizes
    if max(sizes.raw_width * sizes.raw_height, sizes.width * sizes.height) > MAX_PIXELS:
        raise FormatError(
            f"{path} claims to be {sizes.raw_width} x {sizes.raw_height}, more than this program reads "
            f"({MAX_PIXELS // 10**6} megapixels)"
        )
    if raw.num_colors != 3 or set(raw.color_desc.rstrip(b"\0")) != set(b"RGB"):
        colours = raw.color_desc.rstrip(b"\0").decode("ascii", "replace")[: max(raw.num_colors, 1)]
        raise FormatError(
            f"{path} is from a sensor that sees {raw.num_colors} colour(s) ({colours}) where red, green and blue are "
            "needed; take the photo with another camera"
        )


def _developed(raw: Any, rawpy: Any, path: Path) -> Image:
    flip, exposure_time = raw.sizes.flip, raw.other.shutter_speed  # read before postprocess resets them
    developed = raw.postprocess(
        demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
        user_wb=[1, 1, 1, 1],
        output_color=rawpy.ColorSpace.raw,
        gamma=(1, 1),
        output_bps=16,
        highlight_mode=rawpy.HighlightMode.Clip,
        no_auto_bright=True,
        adjust_maximum_thr=0,  # otherwise a photo's brightest pixel becomes its white level
        user_flip=0,  # rotated below, with `clipped`
    )
    clipped = _clipped(raw)
    if developed.shape != clipped.shape:
        raise FormatError(
            f"{path} is from a sensor whose pixels are not square or stand in slanted rows, which this program does "
            "not read; convert it to a linear TIFF and set the encoding to linear (--encoding linear)"
        )
    rows, columns = _crop(raw.sizes)
    orientation = _ORIENTATIONS[flip & 7]
    developed, clipped = (oriented(values[rows, columns], orientation) for values in (developed, clipped))
    pixels = np.empty(developed.shape, np.float32)
    for rows in bands(len(pixels)):
        pixels[rows] = developed[rows] / np.float32(65535)
    clipped = np.ascontiguousarray(clipped)
    return Image(pixels, None, np.inf, clipped, exposure_time or None, orientation=orientation)


def _crop(sizes: Any) -> tuple[slice, slice]:
    """Rows and columns of the recommended crop (DefaultCropSize), which the camera's own JPEG shows; all without one.

    Demosaicing needs the pixels around it.
    """
    top, left = sizes.crop_top_margin - sizes.top_margin, sizes.crop_left_margin - sizes.left_margin
    height, width = sizes.crop_height, sizes.crop_width
    inside = 0 <= top <= sizes.height - height and 0 <= left <= sizes.width - width
    if not (height and width and inside):
        return slice(None), slice(None)
    return slice(top, top + height), slice(left, left + width)


def _clipped(raw: Any) -> Bools:
    """(H, W, 3) where a channel's site, or one that it is interpolated from, is saturated; before rotation."""
    sites = raw.raw_image_visible
    black = np.array(raw.black_level_per_channel, float)
    white = np.minimum(raw.white_level, raw.camera_white_level_per_channel or raw.white_level)
    white = np.where(white > black, white, raw.white_level)
    ends = black + SATURATED_SHARE * (white - black)
    clipped: Bools
    if sites.ndim == 3:  # every pixel has all three
        clipped = sites[..., :3] >= ends[:3]
        return clipped
    colours = raw.raw_colors_visible
    clipped = np.zeros((*sites.shape, 3), bool)
    saturated = sites >= ends.astype(sites.dtype)[colours]
    for colour in range(4):  # 3 is the second green
        clipped[..., colour % 3 if colour < 3 else 1] |= saturated & (colours == colour)
    return dilated(clipped, 1)
