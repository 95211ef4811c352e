"""Reduced sizes for smooth images, and bilinear upsampling back."""

import numpy as np

from mpsnet_core.arrays.types import F32, I64


def reduced_shape(height: int, width: int, longest: int) -> tuple[int, int]:
    """Height and width of an image scaled down to at most `longest` pixels on its longer side.

    >>> reduced_shape(3000, 6000, 1024)
    (512, 1024)
    """
    scale = min(1.0, longest / max(height, width))
    return max(1, round(height * scale)), max(1, round(width * scale))


def chosen_pixels(small_height: int, small_width: int, height: int, width: int) -> tuple[I64, I64]:
    """(h,) rows and (w,) columns of a large image's pixels at the centres of a small one's.

    The other way round, with the sizes swapped, those of the small image's pixels that contain the large one's centres.
    """
    rows = ((np.arange(small_height) + 0.5) * height / small_height).astype(np.int64)
    columns = ((np.arange(small_width) + 0.5) * width / small_width).astype(np.int64)
    return rows, columns


def upsampled(values: F32, shape: tuple[int, ...], rows: slice) -> F32:
    """Values (h, w, ...) of a small image, interpolated bilinearly for `rows` of a large one of `shape` (H, W)."""
    return _along(_along(values, 0, shape[0], rows), 1, shape[1], slice(None))


def _along(values: F32, axis: int, length: int, chosen: slice) -> F32:
    count = values.shape[axis]
    if count == length:
        return values[(slice(None),) * axis + (chosen,)]
    position = np.clip((np.arange(length)[chosen] + 0.5) * count / length - 0.5, 0, count - 1)
    first = np.minimum(position.astype(np.int64), max(count - 2, 0))
    weight = (position - first).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(values.ndim)])
    low, high = values.take(first, axis), values.take(np.minimum(first + 1, count - 1), axis)
    interpolated: F32 = low + weight * (high - low)
    return interpolated
