"""Meshes of unit squares side by side, of which each has half of a unit square of UV space."""

import numpy as np

from mpsnet_core.scene.mesh import Mesh, labels_of_runs

CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def squares(
    *lower_left: tuple[float, float], materials: str = "", objects: str = "", height: float = 0.0, side: float = 0.5
) -> Mesh:
    """Squares in z = `height` that face +z, the first from (0, 0) to (1, 1), the next 2 to the right, and so on.

    lower_left: where each one's UVs begin; they are `side` wide. materials, objects: a word for each square.
    """
    count = len(lower_left)
    vertices = np.concatenate([np.c_[CORNERS + np.array([2 * n, 0]), np.full(4, height)] for n in range(count)])
    triangles = np.concatenate([HALVES + 4 * n for n in range(count)])
    uvs = np.concatenate([side * CORNERS[HALVES] + place for place in lower_left])
    return Mesh(
        vertices,
        triangles,
        np.broadcast_to([0.0, 0.0, 1.0], (2 * count, 3, 3)),
        uvs,
        materials=labels_of_runs((word, 2) for word in materials.split()) if materials else None,
        objects=labels_of_runs((word, 2) for word in objects.split()) if objects else None,
    )
