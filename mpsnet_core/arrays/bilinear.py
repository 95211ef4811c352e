"""Bilinear lookup between the pixels of an image."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mpsnet_core.arrays.types import Floats


def bilinear(
    image: NDArray[Any], x: Floats, y: Floats, dtype: DTypeLike = np.float64, *, repeat: bool = False
) -> Floats:
    """Values of an image (H, W) or (H, W, C) at pixel coordinates `x` to the right and `y` down, in their shape.

    Pixel centres are at index + 0.5. Beyond the outermost centres, values are clamped to the border, or the image
    repeats. They are computed and returned as `dtype`.

    >>> bilinear(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([0.5, 1.0, 9.0]), np.array([0.5, 1.0, 0.0])).tolist()
    [0.0, 1.5, 1.0]
    >>> bilinear(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([-1.5, 2.0]), np.array([4.5, 0.5]), repeat=True).tolist()
    [0.0, 0.5]
    """
    height, width = image.shape[:2]
    if repeat:
        x, y = np.mod(x - 0.5, width), np.mod(y - 0.5, height)
    else:
        x, y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, below = left + 1, top + 1
    alone = (1,) * (image.ndim - 2)
    across, down = (part.astype(dtype).reshape(*part.shape, *alone) for part in (x - left, y - top))
    if repeat:  # a remainder just below the width may be rounded to it
        left, top, right, below = left % width, top % height, right % width, below % height
    else:
        right, below = np.minimum(right, width - 1), np.minimum(below, height - 1)
    pixels = image.reshape(height * width, *image.shape[2:])
    upper, upper_right, lower, lower_right = (
        pixels.take(row * width + column, axis=0).astype(dtype, copy=False)
        for row in (top, below)
        for column in (left, right)
    )
    upper += (upper_right - upper) * across
    lower += (lower_right - lower) * across
    upper += (lower - upper) * down
    return upper
