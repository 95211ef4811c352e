"""Camera raw files, written by hand: Adobe's DNG specification 1.4 and TIFF 6.0, one strip, not compressed."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

BYTE, ASCII, SHORT, LONG, RATIONAL, SRATIONAL = 1, 2, 3, 4, 5, 10
FORMS = {BYTE: "B", ASCII: "B", SHORT: "H", LONG: "I", RATIONAL: "II", SRATIONAL: "ii"}

# CFAPlaneColor: red, green, blue, cyan, magenta, yellow, white.
FILTERS = "RGBCMYW"

# Which channel stands where in the mosaic, by its 2 x 2 letters row by row; X-Trans repeats after 6 x 6.
BAYER = "RGGB"
X_TRANS = "GBGGRGRGRBGBGBGGRGGRGGBGBGBRGRGRGGBG"


def mosaic(image: np.ndarray, pattern: str = BAYER) -> np.ndarray:
    """(H, W) what a sensor under the colour filters `pattern` sees of an image (H, W, 3)."""
    side = round(len(pattern) ** 0.5)
    channels = np.array(["RGB".index(letter) for letter in pattern]).reshape(side, side)
    rows, columns = np.indices(image.shape[:2]) % side
    return np.take_along_axis(image, channels[rows, columns][..., None], axis=2)[..., 0]


def filled_in(path: Path, method: str) -> np.ndarray:
    """(H, W, 3) what LibRaw makes of a file by one of its methods to fill in the mosaic, linear, nothing else done."""
    import rawpy

    with rawpy.imread(str(path)) as raw:
        return raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm[method],
            output_color=rawpy.ColorSpace.raw,
            user_wb=[1, 1, 1, 1],
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0,
            output_bps=16,
        )


def write_dng(
    path: Path,
    values: np.ndarray,
    *,
    pattern: str = BAYER,
    black: int | Sequence[int] = 0,
    white: int | Sequence[int] = 65535,
    neutral: Sequence[float] = (1, 1, 1),
    matrix: Sequence[float] = (1, 0, 0, 0, 1, 0, 0, 0, 1),
    orientation: int = 1,
    baseline_exposure: float = 0,
    exposure_time: float | None = None,
    size: tuple[int, int] | None = None,
    crop: tuple[int, int, int, int] | None = None,
    compression: int = 1,
) -> Path:
    """Write whole numbers: (H, W) as a mosaic under colour filters, (H, W, 3) as an image whose pixels have all three.

    pattern: letters of FILTERS, row by row. black: one level, or one for each place of a 2 x 2 mosaic. size: the
    (height, width) that the header says, where it lies. crop: the recommended one, as left, top, width and height.
    """
    values = np.asarray(values)
    height, width = size or values.shape[:2]
    channels = values.shape[2] if values.ndim == 3 else 1
    data = values.astype("<u2").tobytes()
    side = round(len(pattern) ** 0.5)
    blacks, whites = np.atleast_1d(black), np.atleast_1d(white)
    tags: list[tuple[int, int, Sequence[Any]]] = [
        (254, LONG, [0]),  # NewSubfileType: the full picture
        (256, LONG, [width]),
        (257, LONG, [height]),
        (258, SHORT, [16] * channels),
        (259, SHORT, [compression]),
        (262, SHORT, [32803 if channels == 1 else 34892]),  # CFA or LinearRaw
        (271, ASCII, b"Nobody\0"),
        (272, ASCII, b"Test\0"),
        (273, LONG, [0]),  # StripOffsets: set below
        (274, SHORT, [orientation]),
        (277, SHORT, [channels]),
        (278, LONG, [height]),
        (279, LONG, [len(data)]),
        (284, SHORT, [1]),
        (50706, BYTE, [1, 4, 0, 0]),  # DNGVersion
        (50707, BYTE, [1, 1, 0, 0]),
        (50708, ASCII, b"Nobody Test\0"),  # UniqueCameraModel
        (50714, LONG, blacks),  # BlackLevel
        (50717, LONG, whites),  # WhiteLevel
        (50721, SRATIONAL, [part for value in matrix for part in (round(value * 10000), 10000)]),  # ColorMatrix1
        (50728, RATIONAL, [part for value in neutral for part in (round(value * 10000), 10000)]),  # AsShotNeutral
        (50730, SRATIONAL, [round(baseline_exposure * 100), 100]),
        (50778, SHORT, [21]),  # CalibrationIlluminant1: D65
    ]
    if channels == 1:
        tags += [
            (33421, SHORT, [side, side]),  # CFARepeatPatternDim
            (33422, BYTE, [FILTERS.index(letter) for letter in pattern]),  # CFAPattern
            (50710, BYTE, sorted({*range(3), *map(FILTERS.index, pattern)})),  # CFAPlaneColor
            (50711, SHORT, [1]),
        ]
        if len(blacks) > 1:
            tags.append((50713, SHORT, [2, 2]))  # BlackLevelRepeatDim
    if crop is not None:
        tags += [(50719, LONG, crop[:2]), (50720, LONG, crop[2:])]  # DefaultCropOrigin, DefaultCropSize
    if exposure_time is not None:
        tags.append((33434, RATIONAL, [round(exposure_time * 10000), 10000]))
    path.write_bytes(_tiff(tags, data))
    return path


def _tiff(tags: list[tuple[int, int, Sequence[Any]]], data: bytes) -> bytes:
    tags = sorted(tags)
    packed = {tag: b"".join(_packed(kind, values)) for tag, kind, values in tags}
    directory_end = 8 + 2 + 12 * len(tags) + 4
    extra, entries = b"", b""
    for tag, kind, values in tags:
        body = packed[tag]
        count = len(values) // (2 if kind in (RATIONAL, SRATIONAL) else 1)
        if tag == 273:
            body = struct.pack("<I", directory_end + sum(len(p) + len(p) % 2 for p in packed.values() if len(p) > 4))
        if len(body) > 4:
            place, extra = directory_end + len(extra), extra + body + bytes(len(body) % 2)
            body = struct.pack("<I", place)
        entries += struct.pack("<HHI", tag, kind, count) + body.ljust(4, b"\0")
    return struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(4) + extra + data


def _packed(kind: int, values: Sequence[Any]) -> list[bytes]:
    form = FORMS[kind]
    values = [int(value) for value in values]
    return [struct.pack(f"<{form}", *values[i : i + len(form)]) for i in range(0, len(values), len(form))]
