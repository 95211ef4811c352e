"""Shapes: closed surfaces drawn from a seed, and meshes from files, brought to one size."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Shape:
    """A triangle mesh in its own space: centred at the origin, z up, bounding sphere of radius 1.

    vertices: (V, 3) float64. triangles: (T, 3) int32, counter-clockwise seen from outside.
    corner_normals: (T, 3, 3) float32 unit shading normals. parts: (T,) int32, the part each triangle belongs to.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    corner_normals: NDArray[np.float32]
    parts: NDArray[np.int32]
