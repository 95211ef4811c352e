"""Sampling of directions: orthonormal frames, evenly spread points on a disc, and dithering between pixels.

Points on the unit disc give both directions to a light, on a small disc tangent to the sphere, and cosine-distributed
directions above a surface, projected onto the hemisphere (Malley's method).
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F64, I64

Kind = TypeVar("Kind", np.float32, np.float64)
GOLDEN_RATIO = (np.sqrt(5) - 1) / 2


def frames(axes: NDArray[Kind]) -> tuple[NDArray[Kind], NDArray[Kind]]:
    """Two unit vectors (N, 3) each that complete the unit `axes` (N, 3) to orthonormal frames (Duff et al. 2017)."""
    x, y, z = axes.T
    sign = np.copysign(axes.dtype.type(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)


def disc(count: int, turns: int = 1) -> F64:
    """(turns, count, 2) evenly spread points on the unit disc, by Vogel's sunflower spiral (1979).

    The `turns` rotated sets fill each other's gaps.
    """
    turn, number = np.mgrid[:turns, :count]
    radius = np.sqrt((number + (turn * GOLDEN_RATIO + 0.5) % 1) / count)
    angle = 2 * np.pi * (GOLDEN_RATIO * number + turn / turns)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def tiled(side: int, shape: tuple[int, int]) -> I64:
    """(H, W) tiled Bayer matrix: numbers 0 to side² - 1, far apart for neighbours. side: of a tile, a power of 2."""
    matrix = np.zeros((1, 1), np.int64)
    while len(matrix) < side:
        matrix = np.block([[4 * matrix, 4 * matrix + 2], [4 * matrix + 3, 4 * matrix + 1]])
    height, width = shape
    return np.tile(matrix, (-(-height // side), -(-width // side)))[:height, :width]
