"""A mesh's UV islands, and the seams where they meet on the surface."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.arrays.types import F64, I32, I64
from mpsnet_core.scene.mesh import Mesh

# UVs closer than this coincide; a texel of the largest texture is 60 times as wide.
SAME_UV = 1e-6
# Limit of whole numbers.
FARTHEST = 2.0**62
# A direction that is unlikely to lie in a plane of symmetry.
ASKEW = np.array([0.62, 0.55, 0.56])


@dataclass(frozen=True)
class Islands:
    """UV islands: triangles that are connected in UV space, and the seams that separate them on the surface."""

    of_triangle: I32
    """(T,). Number of each triangle's island, from 0. Islands are ordered by their position in space, which does not
    change when the mesh is subdivided."""
    seam_uvs: F64
    """(E, 2 sides, 2 ends, 2). UVs of the surface's edges that lie at two places in the texture. The ends are in the
    same order on both sides."""
    seam_islands: I32
    """(E, 2). The island on either side."""

    @property
    def count(self) -> int:
        """The number of islands."""
        return int(self.of_triangle.max()) + 1


def islands_of(mesh: Mesh) -> Islands:
    """A mesh's islands. Vertices at the same point, which some files split at seams, are merged. An edge of more than
    two triangles joins them in pairs."""
    places = welded(mesh)
    texture = np.round(np.clip(mesh.uvs.astype(np.float64) / SAME_UV, -FARTHEST, FARTHEST)).astype(np.int64)
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


def welded(mesh: Mesh) -> I64:
    """(T, 3) vertex indices of the triangles' corners, equal for vertices at the same point."""
    return np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.triangles]


def _in_order(mesh: Mesh, islands: I64) -> I32:
    middles = mesh.vertices[mesh.triangles].mean(axis=1) @ ASKEW
    mean = np.bincount(islands, middles) / np.bincount(islands)
    rank = np.empty(len(mean), np.int32)
    rank[np.argsort(mean)] = np.arange(len(mean), dtype=np.int32)
    return rank[islands]
