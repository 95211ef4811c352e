"""Directions: frames around unit vectors, points spread evenly over a disc, and rotations from pixel to pixel.

Directions on a small disc around a light, and cosine-distributed ones above a surface, both are points of the unit
disc: the first in the plane that touches the sphere, the second lifted onto the hemisphere (Malley's method).
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = TypeVar("Floats", np.float32, np.float64)
GOLDEN_RATIO = (np.sqrt(5) - 1) / 2


def frames(axes: NDArray[Floats]) -> tuple[NDArray[Floats], NDArray[Floats]]:
    """Two unit vectors each (N, 3) at right angles to one another and to the unit `axes` (N, 3) (Duff et al. 2017)."""
    x, y, z = axes.T
    sign = np.copysign(axes.dtype.type(1), z)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)


def disc(count: int, turns: int = 1) -> NDArray[np.float64]:
    """(turns, count, 2) points spread evenly over the unit disc, as in a sunflower (Vogel 1979).

    Each of the `turns` sets fills gaps that the others leave.
    """
    turn, number = np.mgrid[:turns, :count]
    radius = np.sqrt((number + (turn * GOLDEN_RATIO + 0.5) % 1) / count)
    angle = 2 * np.pi * (GOLDEN_RATIO * number + turn / turns)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def tiled(side: int, shape: tuple[int, int]) -> NDArray[np.int64]:
    """(H, W) numbers 0 to side² - 1 in tiles of side x side (a power of 2), neighbours far apart (Bayer's matrix)."""
    matrix = np.zeros((1, 1), np.int64)
    while len(matrix) < side:
        matrix = np.block([[4 * matrix, 4 * matrix + 2], [4 * matrix + 3, 4 * matrix + 1]])
    height, width = shape
    return np.tile(matrix, (-(-height // side), -(-width // side)))[:height, :width]
