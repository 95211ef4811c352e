"""The surface under a texture's points: position, normal and tangent, linear over each triangle."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rasterize import texel_coordinates
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.bake.texture import Space
from mpsnet_core.scene.mesh import Mesh


class Place(NamedTuple):
    """Points of a texture, each (N,): the triangle under it, and its column and row."""

    triangle: NDArray[np.int64]
    column: NDArray[np.int64]
    row: NDArray[np.int64]


class UnderTexels:
    """T triangles of a mesh: of each layer a value at the triangle's first corner and steps along columns and rows.

    triangles: which of the mesh's, None for all. corner: the unit square of UV space that is the texture. size: of the
    texture, in points on a side. middle: what positions are relative to, because far from the origin float32 would be
    too coarse.

    corners: (T, 3, 2) texel coordinates. normal, tangent, position: (T, 3, 3), see :meth:`linear`; positions in the
    world, the others in object space.
    """

    def __init__(
        self,
        mesh: Mesh,
        triangles: NDArray[np.int64] | None,
        corner: tuple[int, int],
        middle: NDArray[np.float64],
        size: int,
    ) -> None:
        chosen = slice(None) if triangles is None else triangles
        uvs = mesh.uvs[chosen]
        self.corners = corners = texel_coordinates(uvs - np.array(corner, float) if any(corner) else uvs, size)
        self.origin = corners[:, 0].astype(np.float32)
        e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
        inverse = np.where(np.abs(area) > 1e-12, 1 / np.where(area == 0, 1, area), 0)
        # Steps of the second and third barycentric coordinate along x and y: (T, 2 coordinates, 2 axes).
        self.steps = inverse[:, None, None] * np.stack(
            [np.stack([e2[:, 1], -e2[:, 0]], -1), np.stack([-e1[:, 1], e1[:, 0]], -1)], axis=1
        )
        tangents = mesh.tangents[chosen]
        self.normal = self.linear(mesh.corner_normals[chosen])
        self.tangent = self.linear(tangents[..., :3])
        self.position = self.linear(mesh.world_vertices[mesh.triangles[chosen]] - middle)
        self.sign = tangents[:, 0, 3]
        # Normals are carried to world space by the inverse transpose, and back by the transpose.
        self.object_from_world_normals = mesh.world_from_object[:3, :3].T.astype(np.float32)
        self.world_from_object_normals = np.linalg.inv(mesh.world_from_object[:3, :3]).T.astype(np.float32)

    def linear(self, at_corners: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """(T, 3, K) corner values as (T, 3, K): the value at the first corner, its step along x, along y."""
        first = at_corners[:, 0]
        differences = np.stack([at_corners[:, 1] - first, at_corners[:, 2] - first], axis=1)
        return np.concatenate(
            [first[:, None], np.einsum("tbk,tba->tak", differences, self.steps)], axis=1, dtype=np.float32
        )

    def at(self, place: Place, *layers: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """(N, K) values of :meth:`linear`'s layers at some points."""
        origin = self.origin[place.triangle]
        x = (place.column - origin[:, 0]).astype(np.float32)[:, None]
        y = (place.row - origin[:, 1]).astype(np.float32)[:, None]
        values = (layer[place.triangle] for layer in layers)
        return [value[:, 0] + value[:, 1] * x + value[:, 2] * y for value in values]

    def points(self, place: Place) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(N, 3) points, and (N, 3) unit shading normals in world space."""
        position, normal = self.at(place, self.position, self.normal)
        return position, normalised(normal @ self.world_from_object_normals.T)

    def encoded(self, place: Place, vectors: NDArray[np.float32], space: Space, strength: float) -> NDArray[np.float32]:
        """(N, 3) unit normals in `space` from vectors (N, 3) in world space; the surface's own where those are zero.

        strength: what the gradients against the surface's own normals are multiplied by.
        """
        normal, tangent = self.at(place, self.normal, self.tangent)
        baked = np.where(np.any(vectors, axis=1)[:, None], vectors @ self.object_from_world_normals.T, normal)
        if strength != 1:
            own = normalised(normal)
            along = np.einsum("ni,ni->n", baked, own)[:, None] * own
            baked = along + np.float32(strength) * (baked - along)
        if space == "tangent":
            baked = _to_tangent_space(baked, normal, tangent, self.sign[place.triangle])
        return normalised(baked)


def _to_tangent_space(
    vectors: NDArray[np.float32],
    normal: NDArray[np.float32],
    tangent: NDArray[np.float32],
    sign: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Solve ``v = x T + y B + z N`` up to scale, with the interpolated T and N as they are and B = sign N x T.

    Renderers interpolate T and N without making them perpendicular again; the inverse of what they do is exact.
    """
    bitangent = np.cross(normal, tangent) * sign[:, None]
    volume = np.einsum("ni,ni->n", tangent, np.cross(bitangent, normal))
    inverse = np.stack([np.cross(bitangent, normal), np.cross(normal, tangent), np.cross(tangent, bitangent)], axis=1)
    solved: NDArray[np.float32] = np.einsum("nij,nj->ni", inverse, vectors) * np.sign(volume)[:, None]
    return solved
