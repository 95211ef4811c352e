"""What a mesh file says of its polygons, before it is checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F64, I64
from mpsnet_core.errors import GeometryError


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons of any number of corners, and what the file says of these."""

    vertices: F64
    """(V, 3) float64. Positions."""
    corners: I64
    """(C,) int64. Vertex index of each corner, polygon after polygon."""
    sizes: I64
    """(F,) int64. Number of corners of each polygon."""
    uvs: F64 | None = None
    """(C, 2) float64. UV coordinates with v up, NaN where the file gives none; None if it gives none at all."""
    normals: F64 | None = None
    """(C, 3) float64. Normals of any length, NaN or zero where the file gives none; None if it gives none at all."""
    tangents: F64 | None = None
    """(C, 4) float64. Unit tangent and the sign of the bitangent, NaN where the file gives none; None if it gives none
    at all."""
    smoothing: I64 | None = None
    """(F,) int64. For corners without a normal: polygons of the same number share one at each common vertex. A polygon
    of number 0 is flat. None: all are flat."""
    materials: Sequence[tuple[str, int]] | None = None
    """Names of materials, each with the number of polygons that it applies to, in order."""
    objects: Sequence[tuple[str, int]] | None = None
    """Names of objects, each with the number of polygons that it applies to, in order."""


def checked_indices(numbers: NDArray[Any], count: int) -> I64:
    """Vertex indices as integers. Raises GeometryError if one is not below `count`, the number of vertices."""
    if numbers.size and not 0 <= numbers.min() <= numbers.max() < count:
        raise GeometryError("the mesh's triangles name vertices that it does not have; export it again")
    return numbers.astype(np.int64)
