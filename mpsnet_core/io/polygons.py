"""What a mesh file says of its polygons, before it is checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import GeometryError


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons of any number of corners, and what the file says of these.

    Parameters
    ----------
    vertices : (V, 3) array
    corners : (C,) array
        Vertex index of each corner, polygon after polygon.
    sizes : (F,) array
        Number of corners of each polygon.
    uvs : (C, 2) array, optional
        With v up; NaN where the file gives none.
    normals : (C, 3) array, optional
        Of any length; NaN or zero where the file gives none.
    tangents : (C, 4) array, optional
        Unit tangent and the sign of the bitangent; NaN where the file gives none.
    smoothing : (F,) array of int, optional
        For corners without a normal: polygons of the same number share one at each common vertex. A polygon of number
        0 is flat. All are by default.
    materials, objects : sequence of (str, int), optional
        Names with the number of polygons that each applies to, in order.
    """

    vertices: NDArray[np.float64]
    corners: NDArray[np.int64]
    sizes: NDArray[np.int64]
    uvs: NDArray[np.float64] | None = None
    normals: NDArray[np.float64] | None = None
    tangents: NDArray[np.float64] | None = None
    smoothing: NDArray[np.int64] | None = None
    materials: Sequence[tuple[str, int]] | None = None
    objects: Sequence[tuple[str, int]] | None = None


def checked_indices(numbers: NDArray[Any], count: int) -> NDArray[np.int64]:
    """Vertex indices as integers. Raises GeometryError if one is not below `count`, the number of vertices."""
    if numbers.size and not 0 <= numbers.min() <= numbers.max() < count:
        raise GeometryError("the mesh's triangles name vertices that it does not have; export it again")
    return numbers.astype(np.int64)
