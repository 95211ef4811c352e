"""A mesh's UV islands, and the seams at which they meet on the surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.scene.mesh import Mesh

# UVs nearer than this are one; a texel of the largest texture is 60 times as wide.
SAME_UV = 1e-6
# A direction that no plane of symmetry is likely to hold.
ASKEW = np.array([0.62, 0.55, 0.56])


@dataclass(frozen=True)
class Islands:
    """Triangles that hang together in the texture, and where they hang together on the surface alone.

    of_triangle: (T,) the number of each triangle's island, from 0: by where the islands lie in space, so that it is the
    same when the mesh is subdivided.
    seam_uvs: (E, 2 sides, 2 ends, 2) the UVs of the surface's edges that lie at two places of the texture; the ends are
    in the same order on both sides. seam_islands: (E, 2) the island on either side.
    """

    of_triangle: NDArray[np.int32]
    seam_uvs: NDArray[np.float64]
    seam_islands: NDArray[np.int32]


def islands_of(mesh: Mesh) -> Islands:
    """A mesh's islands. Vertices at one point, which some files split at seams, are one; an edge of more than two
    triangles joins two and two of them."""
    places = welded(mesh)
    texture = np.round(mesh.uvs.astype(np.float64) / SAME_UV).astype(np.int64)
    start, end = (0, 1, 2), (1, 2, 0)
    ends = np.stack([places[:, start], places[:, end]], axis=-1).reshape(-1, 2)
    rounded = np.stack([texture[:, start], texture[:, end]], axis=2).reshape(-1, 2, 2)
    uvs = np.stack([mesh.uvs[:, start], mesh.uvs[:, end]], axis=2).reshape(-1, 2, 2).astype(np.float64)
    turned = ends[:, 0] > ends[:, 1]
    for values in (ends, rounded, uvs):
        values[turned] = values[turned, ::-1]
    order = np.lexsort((*rounded.reshape(-1, 4).T, ends[:, 1], ends[:, 0]))
    one, other = order[:-1], order[1:]
    shared = (ends[one] == ends[other]).all(axis=1)
    same = (rounded[one] == rounded[other]).all(axis=(1, 2))
    root = connected(len(places), one[shared & same] // 3, other[shared & same] // 3)
    islands = _in_order(mesh, np.unique(root, return_inverse=True)[1].reshape(-1))
    sides = np.stack([one, other], axis=1)[shared & ~same]
    return Islands(islands, uvs[sides], islands[sides // 3])


def welded(mesh: Mesh) -> NDArray[np.int64]:
    """(T, 3) numbers of the corners' places: of vertices at the same point the same."""
    return np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.triangles]


def _in_order(mesh: Mesh, islands: NDArray[np.int64]) -> NDArray[np.int32]:
    middles = mesh.vertices[mesh.triangles].mean(axis=1) @ ASKEW
    mean = np.bincount(islands, middles) / np.bincount(islands)
    rank = np.empty(len(mean), np.int32)
    rank[np.argsort(mean)] = np.arange(len(mean), dtype=np.int32)
    return rank[islands]
