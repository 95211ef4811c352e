"""EXIF data, written by hand after the standard (CIPA DC-008), into JPEG files."""

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

# Tag and type of each: a whole number of 16 or 32 bits, or a fraction.
TAGS = {
    "FocalLength": (0x920A, 5),
    "PixelXDimension": (0xA002, 4),
    "PixelYDimension": (0xA003, 4),
    "FocalPlaneXResolution": (0xA20E, 5),
    "FocalPlaneResolutionUnit": (0xA210, 3),
    "FocalLengthIn35mmFilm": (0xA405, 3),
}


def exif_data(values: Mapping[str, float]) -> bytes:
    """A TIFF header, a directory that points to that of EXIF, and this."""
    start, entries, fractions = 26, b"", b""
    place = start + 2 + 12 * len(values) + 4
    for tag, kind, value in sorted((*TAGS[name], value) for name, value in values.items()):
        if kind == 5:
            content = struct.pack("<I", place + len(fractions))
            fractions += struct.pack("<II", round(value * 1000), 1000)
        else:
            content = struct.pack("<H2x" if kind == 3 else "<I", int(value))
        entries += struct.pack("<HHI", tag, kind, 1) + content
    first = struct.pack("<2sHIHHHIII", b"II", 42, 8, 1, 0x8769, 4, 1, start, 0)
    return first + struct.pack("<H", len(values)) + entries + bytes(4) + fractions


def write_jpeg(path: Path, size: tuple[int, int], values: Mapping[str, float], image: np.ndarray | None = None) -> Path:
    """A JPEG with EXIF data. size: its width and height. image: (H, W, 3) values of 0 to 1; grey by default."""
    width, height = size
    pixels = np.full((height, width, 3), 0.5) if image is None else image
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(width, height, 3, oiio.UINT8))
    output.write_image((255 * pixels).round().astype(np.uint8))
    output.close()
    whole, data = path.read_bytes(), b"Exif\0\0" + exif_data(values)
    path.write_bytes(whole[:2] + struct.pack(">HH", 0xFFE1, len(data) + 2) + data + whole[2:])
    return path
