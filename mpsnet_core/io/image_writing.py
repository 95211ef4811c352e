"""Images written to files atomically."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.files import atomic_write, checked_bits, temporary_folder
from mpsnet_core.io.image import Image, srgb_to_linear
from mpsnet_core.io.image_input import image_attribute, image_input, pending_error, silence_libraries
from mpsnet_core.io.marks import SOFTWARE, curve_assumed, made
from mpsnet_core.io.metadata import is_provenance_line, metadata
from mpsnet_core.io.opening import AnyPath, is_file

PNG_FILTER_UP = 32  # libpng's number: each pixel is stored as its difference from the one above


def write_image(
    path: AnyPath,
    pixels: NDArray[Any],
    *,
    bits: int | None = None,
    color_space: str = "raw",
    description: str | None = None,
) -> None:
    """Write an image atomically, without applying a curve.

    Parameters
    ----------
    path : path-like
        A .png, .tif or .exr file.
    pixels : (H, W) or (H, W, C) array
        The last of four channels is alpha, not premultiplied.
    bits : int, optional
        8, 16 or 32 per channel, as the format allows. Integers store 0 to 1; 16 bits in EXR are half floats.
    color_space : str, optional
        "raw" for data, "sRGB" for images with that curve.
    description : str, optional
        A line of text to store in the file.

    Raises
    ------
    FileError
        If the file cannot be written.
    SettingsError
        If the format, the bits or the shape are not supported.
    """
    pixels = np.asarray(pixels)
    if pixels.ndim not in (2, 3) or not pixels.size or pixels.shape[2:] > (4,):
        raise SettingsError(
            f"{path}: an array of shape {pixels.shape} is not an image; give rows and columns, and one to four channels"
        )
    pixels = pixels if pixels.ndim == 3 else pixels[..., None]
    height, width, channels = pixels.shape
    shape = height, width, channels
    write_bands(path, shape, pixels.__getitem__, bits=bits, color_space=color_space, description=description)


def write_photo(
    path: AnyPath, photo: Image, *, bits: int | None, linear: bool = True, description: str | None = None
) -> None:
    """Write a photo that was made of others, with its alpha. If its encoding is assumed, the file says so.

    linear: whether its values are, or have the sRGB curve. description: of a photo whose encoding is known. Raises as
    :func:`write_image` does.
    """
    values = photo.pixels if photo.alpha is None else np.concatenate([photo.pixels, photo.alpha[..., None]], axis=-1)
    unstated = not linear and photo.assumed == "srgb"
    space = "lin_rec709_scene" if linear else "unknown" if unstated else "sRGB"
    said = description or (curve_assumed(photo.assumed) if linear else None)
    write_image(path, values, bits=bits, color_space=space, description=said)


def write_picture(path: AnyPath, pixels: NDArray[Any], *, description: str | None = None) -> None:
    """Write an image of sRGB values (H, W, 3) for display: 8 bits; in an EXR linear floats, which viewers expect.

    description: a line of text to store in the file. Raises as :func:`write_image` does.
    """
    height, width, channels = pixels.shape
    write_picture_bands(path, (height, width, channels), lambda rows: pixels[rows], description=description)


def write_picture_bands(
    path: AnyPath, shape: tuple[int, int, int], band: Callable[[slice], NDArray[Any]], *, description: str | None = None
) -> None:
    """Write an image as :func:`write_picture` does, computed band by band as in :func:`write_bands`."""
    description = description or made("picture")
    if Path(path).suffix.lower() == ".exr":
        linear = "lin_rec709_scene"
        write_bands(path, shape, lambda rows: srgb_to_linear(band(rows)), color_space=linear, description=description)
    else:
        write_bands(path, shape, band, bits=8, color_space="sRGB", description=description)


def write_mask(path: AnyPath, mask: NDArray[Any]) -> None:
    """Write a mask, or values (H, W) from 0 to 1 in a few levels: 8 bits; in an EXR floats.

    Raises as :func:`write_image` does.
    """
    write_image(path, mask, bits=None if Path(path).suffix.lower() == ".exr" else 8, description=made("mask"))


def write_bands(
    path: AnyPath,
    shape: tuple[int, int, int],
    band: Callable[[slice], NDArray[Any]],
    *,
    bits: int | None = None,
    color_space: str = "raw",
    description: str | None = None,
) -> None:
    """Write an image of `shape` (H, W, C) atomically, computed band by band.

    band: returns the values (h, W, C) of the given rows, from top to bottom. The rest as for :func:`write_image`.
    """
    spec = _output_spec(Path(path), shape, bits, color_space, description)
    if facts := metadata(with_inputs=not is_provenance_line(description or "")):
        spec.attribute(f"{SOFTWARE}:made", facts)
    _write(Path(path), atomic_write(path), spec, band)


def png_bytes(pixels: NDArray[Any]) -> bytes:
    """An image (H, W, 3) of sRGB values as an 8-bit PNG file. Raises FileError if the disk is full."""
    height, width, channels = pixels.shape
    with temporary_folder() as folder:
        file = folder / "picture.png"
        spec = _output_spec(file, (height, width, channels), 8, "sRGB", None)
        _write(file, nullcontext(file), spec, lambda rows: pixels[rows])
        return file.read_bytes()


def _write(path: Path, place: AbstractContextManager[Path], spec: Any, band: Callable[[slice], NDArray[Any]]) -> None:
    """Write the image `path` to the file that `place` yields."""
    premultiplied = path.suffix.lower() == ".exr" and spec.nchannels == 4  # as OpenEXR defines colour
    with place as file:
        target = oiio.ImageOutput.create(str(file))
        if target is None:
            raise FileError(f"cannot write {path}: {pending_error(oiio)}")
        try:
            with silence_libraries():  # OpenEXR's has words for the missing time
                done = target.open(str(file), spec)
            for rows in bands(spec.height) if done else ():
                values = np.ascontiguousarray(band(rows), dtype=np.float32)
                if premultiplied:
                    values = np.concatenate([values[..., :3] * values[..., 3:], values[..., 3:]], axis=-1)
                done = target.write_scanlines(rows.start, rows.stop, 0, values)
                if not done:
                    break
        finally:
            with silence_libraries():  # libpng reports an incomplete image
                closed = target.close()
        # OpenImageIO reports success even if a full disk truncates the file.
        if not (closed and done and is_complete_image(file)):
            # libpng prints a line for each chunk that the disk rejects.
            reason = pending_error(target, lines=1) or pending_error(oiio) or "the file was cut short"
            raise FileError(f"cannot write {path} ({reason.replace(str(file), path.name)}); make room on the disk")


def _output_spec(
    path: Path, shape: tuple[int, int, int], bits: int | None, color_space: str, description: str | None
) -> Any:
    height, width, channels = shape
    bits, suffix = checked_bits(path, bits), path.suffix.lower()
    is_exr = suffix == ".exr"
    kind = ("half" if bits == 16 else "float") if is_exr else {8: "uint8", 16: "uint16", 32: "float"}[bits]
    spec = oiio.ImageSpec(width, height, channels, kind)
    if suffix == ".png":
        # For normals or photos of 16 bits, smaller files than libpng's defaults in a quarter of the time.
        spec.attribute("compression", "rle")
        spec.attribute("png:filter", PNG_FILTER_UP)
    else:
        spec.attribute("compression", "zip")
    if channels == 4:
        spec.alpha_channel = 3
        if not is_exr:
            spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", color_space)
    spec.attribute("Software", SOFTWARE)
    spec.attribute("DateTime", "")  # OpenImageIO's own would make two equal runs differ
    if description is not None:
        spec.attribute("ImageDescription", description)
    return spec


def is_complete_image(path: AnyPath) -> bool:
    """Whether an image file that this program wrote exists and is not truncated.

    Fast enough for folders of thousands: a PNG ends with a marker, and of other formats only the last rows are read.
    """
    path = Path(path)
    if path.suffix.lower() == ".png":
        if not is_file(path):
            return False
        with suppress(OSError), path.open("rb") as file:
            file.seek(-8, os.SEEK_END)
            return file.read(4) == b"IEND"
        return False
    with silence_libraries():
        source = image_input(path)
        if source is None:
            return False
        with closing(source):
            spec = source.spec()
            strip = max(image_attribute(spec, "tiff:RowsPerStrip", int) or 1, 1)  # strips are decoded completely
            first = (spec.height - 1) // strip * strip
            last = source.read_scanlines(first, spec.height, 0, 0, spec.nchannels, spec.format)
            return last is not None and not pending_error(source)
