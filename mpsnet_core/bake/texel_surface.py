"""Position, normal and tangent of the surface at a texture's sample points, linear over each triangle."""

from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays.rasterize import texel_coordinates
from mpsnet_core.arrays.types import F32, F64, I64, Floats
from mpsnet_core.arrays.unit_vectors import SHORTEST, transformed
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture import Space


class Barycentric(NamedTuple):
    """N sample points of a texture, on the triangles under them."""

    triangle: I64
    """(N,). The triangle under each point."""
    x: F32
    """(N,). Offset from the triangle's first corner, in columns."""
    y: F32
    """(N,). Offset from the triangle's first corner, in rows."""

    def some(self, which: I64) -> "Barycentric":
        return Barycentric(self.triangle.take(which), self.x.take(which), self.y.take(which))


class SurfacePoints(NamedTuple):
    """N points of a surface, in world space."""

    positions: F32
    """(3, N). Positions."""
    normals: F32
    """(3, N). Unit shading normals."""
    outwards: F32
    """(3, N). Unit normals of the triangles, which decide what a camera sees."""


class TexelSampler:
    """T triangles of a mesh under a texture. A layer is a value at the first corner and its steps per column and row.

    triangles: indices of the mesh's triangles, None for all. corner: lower left corner of the texture's unit square in
    UV space. size: of the texture, in sample points across and down. middle: origin of positions, because far from the
    world's origin float32 would be too coarse.

    corners: (T, 3, 2) coordinates in sample points. normal, tangent, position: (9, T), see :meth:`linear`; positions in
    world space, the others in object space.
    """

    def __init__(
        self, mesh: Mesh, triangles: I64 | None, corner: tuple[int, int], middle: F64, size: tuple[int, int]
    ) -> None:
        chosen = slice(None) if triangles is None else triangles
        uvs = mesh.uvs[chosen]
        self.corners = corners = texel_coordinates(uvs - np.array(corner, float) if any(corner) else uvs, size)
        self.origin = np.ascontiguousarray(corners[:, 0].T, np.float32)
        e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
        inverse = np.where(np.abs(area) > 1e-12, 1 / np.where(area == 0, 1, area), 0)
        # Gradients of the second and third barycentric coordinate along x and y: (T, 2 coordinates, 2 axes).
        self.steps = inverse[:, None, None] * np.stack(
            [np.stack([e2[:, 1], -e2[:, 0]], -1), np.stack([-e1[:, 1], e1[:, 0]], -1)], axis=1
        )
        tangents = mesh.tangents[chosen]
        self.normal = self.linear(mesh.corner_normals[chosen])
        self.tangent = self.linear(tangents[..., :3])
        self.position = self.linear(mesh.world_vertices[mesh.triangles[chosen]] - middle)
        self.sign = tangents[:, 0, 3]
        self.outwards = np.ascontiguousarray(mesh.outwards[chosen].T)
        # The inverse transpose maps normals to world space, the transpose maps them back.
        self.object_from_world_normals = mesh.world_from_object[:3, :3].T.astype(np.float32)
        self.world_from_object_normals = mesh.normals_to_world.T.astype(np.float32)

    def linear(self, at_corners: Floats) -> F32:
        """(T, 3, 3) corner values as (9, T): the value at the first corner, its step along x, along y."""
        first = at_corners[:, 0]
        differences = np.stack([at_corners[:, 1] - first, at_corners[:, 2] - first], axis=1)
        steps = np.einsum("tbk,tba->akt", differences, self.steps).reshape(6, -1)
        return np.concatenate([first.T, steps], dtype=np.float32)

    def place(self, triangle: I64, column: I64, row: I64) -> Barycentric:
        """Sample points of the texture from the triangle under them, column and row, each (N,)."""
        x, y = column.astype(np.float32), row.astype(np.float32)
        x -= self.origin[0].take(triangle)
        y -= self.origin[1].take(triangle)
        return Barycentric(triangle, x, y)

    def at(self, place: Barycentric, layer: F32) -> F32:
        """(3, N) values of a layer from :meth:`linear` at sample points."""
        values = layer.take(place.triangle, axis=1)
        values[3:6] *= place.x
        values[6:] *= place.y
        values[:3] += values[3:6]
        values[:3] += values[6:]
        return values[:3]

    def points(self, place: Barycentric, normals: F32) -> "SurfacePoints":
        """The surface under sample points, from its `normals` there. Positions are relative to `middle`."""
        unit = _scaled_to_unit(transformed(self.world_from_object_normals, normals))
        return SurfacePoints(self.at(place, self.position), unit, self.outwards.take(place.triangle, axis=1))

    def frames(self, place: Barycentric) -> tuple[F32, F32]:
        """(3, N) unit tangents and bitangents in object space at sample points, perpendicular to the normals."""
        normal, tangent = _scaled_to_unit(self.at(place, self.normal)), self.at(place, self.tangent)
        tangent = _scaled_to_unit(tangent - normal * _dot(normal, tangent))
        return tangent, self.sign.take(place.triangle) * np.cross(normal, tangent, axis=0)

    def encoded(self, place: Barycentric, normal: F32, vectors: F32, space: Space, strength: float) -> F32:
        """(3, N) unit normals in `space` from vectors (3, N) in world space; the surface's own where those are zero.

        normal: (3, N) the surface's own in object space, as interpolated. strength: factor on the slopes relative to
        them.
        """
        baked = transformed(self.object_from_world_normals, vectors)
        missing = np.flatnonzero(~vectors.any(axis=0))
        baked[:, missing] = normal[:, missing]
        if strength != 1:
            own = _scaled_to_unit(normal.copy())
            along = own * _dot(baked, own)
            baked -= along
            baked *= np.float32(strength)
            baked += along
        if space == "tangent":
            baked = _to_tangent_space(baked, normal, self.at(place, self.tangent), self.sign.take(place.triangle))
        return _scaled_to_unit(baked)


def _dot(one: F32, other: F32) -> F32:
    """(N,) dot products of vectors (3, N)."""
    return np.einsum("in,in->n", one, other)


def _scaled_to_unit(vectors: F32) -> F32:
    """Vectors (3, N), normalised in place. Zero vectors become +z."""
    length = np.sqrt(_dot(vectors, vectors))
    none = np.flatnonzero(length <= SHORTEST)
    length[none] = 1
    vectors[:, none] = [[0], [0], [1]]
    vectors /= length
    return vectors


def _to_tangent_space(vectors: F32, normal: F32, tangent: F32, sign: F32) -> F32:
    """Solve ``v = x T + y B + z N`` up to scale, with the interpolated, unnormalised T and N, and B = sign N x T.

    Renderers interpolate T and N without orthonormalising them again; this inverts that exactly. By Cramer's rule x is
    v · (B x N) over the volume T · (B x N), and so on; B x N = sign (N·N T - N·T N), and so on.
    """
    along_normal, along_tangent = _dot(vectors, normal), _dot(vectors, tangent)
    across = _dot(normal, tangent)
    (x, y, z), (u, v, w) = normal, tangent
    bitangent = np.stack([y * w - z * v, z * u - x * w, x * v - y * u])
    right = along_tangent * _dot(normal, normal) - along_normal * across
    outwards = along_normal * _dot(tangent, tangent) - along_tangent * across
    return np.stack([right, _dot(vectors, bitangent) * sign, outwards])
