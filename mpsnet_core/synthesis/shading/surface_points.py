"""Surface points of a shape at the pixels of a camera."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, I32, I64
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import Hits, RayScene, lift_to_curve
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shading.pattern import bumped
from mpsnet_core.synthesis.shapes import Shape

# Offset of ray origins from the surface, in units of the object's radius.
OFFSET = np.float32(2e-4)
# Interpolated and bumped normals that face away from the viewer, at outlines, are bent back to this cosine.
MIN_FACING = np.float32(0.01)


@dataclass(frozen=True)
class SurfacePoints:
    """N points of the surface, in world space unless stated otherwise."""

    position: F32
    """(N, 3) float32. Position on the surface."""
    start: F32
    """(N, 3) float32. Origin of rays, just above the surface."""
    smooth: F32
    """(N, 3) float32. Unit normals interpolated from the corners."""
    normal: F32
    """(N, 3) float32. Unit normals with bump, facing the viewer."""
    view: F32
    """(N, 3) float32. Unit vectors to the viewer."""
    place: F32
    """(N, 3) float32. Position in object space."""
    part: I32
    """(N,) int32. The part of the shape that each point belongs to."""

    def __len__(self) -> int:
        return len(self.position)

    def subset(self, which: NDArray[np.integer[Any]]) -> "SurfacePoints":
        """Some of the points, by index."""
        return SurfacePoints(*(getattr(self, name).take(which, axis=0) for name in self.__dataclass_fields__))


class Surface:
    """A recipe's shape in world space, prepared for ray casting."""

    def __init__(self, recipe: SceneDescription, shape: Shape) -> None:
        self.bump = recipe.bump
        self.turn = recipe.rotation.T.astype(np.float32)  # row vectors from object to world space
        self.placed = shape.vertices @ recipe.rotation.T
        self.scene = RayScene(self.placed, shape.triangles)
        self.vertices = shape.vertices.astype(np.float32)
        self.triangles, self.parts = np.ascontiguousarray(shape.triangles.T), shape.parts
        self.normals = np.ascontiguousarray(shape.corner_normals.swapaxes(0, 1))

    def seen(self, camera: Camera) -> tuple[I64, F32, SurfacePoints]:
        """Visible surface at pixel centres: indices (N,) in row-major order, depth (N,) along the axis, and points."""
        rows, columns = camera.extent(self.placed)
        row, column = np.mgrid[rows, columns].reshape(2, -1)
        origins, directions, back = self.scene.rays_of(camera, np.stack([column, row], axis=1) + 0.5)
        hits = self.scene.hits(origins, directions)
        found = np.flatnonzero(hits.triangle >= 0)
        view = -directions.take(found, axis=0).astype(np.float32)
        depth = (hits.distance[found] - np.float32(back)) * (view @ camera.rotation[:, 2].astype(np.float32))
        return row[found] * camera.width + column[found], depth, self.points(hits.subset(found), view)

    def points(self, hits: Hits, view: F32, bump: bool = True) -> SurfacePoints:
        """The points at hits, without misses. view: (N, 3) unit vectors back along the rays."""
        weights = (1 - hits.u - hits.v)[:, None], hits.u[:, None], hits.v[:, None]
        # Here and below: `take` is four times as fast as indexing.
        corners = [self.vertices.take(numbers.take(hits.triangle), axis=0) for numbers in self.triangles]
        normals = [vectors.take(hits.triangle, axis=0) for vectors in self.normals]
        place = _blend(weights, corners)
        smooth = normalised(_blend(weights, normals))
        self._face(smooth, normals, corners, view @ self.turn.T)
        lift = OFFSET * smooth
        lift_to_curve(lift, place, weights, corners, normals)
        normal = bumped(self.bump, place, smooth) @ self.turn if bump else smooth @ self.turn
        position = place @ self.turn
        start, smooth, normal = position + lift @ self.turn, smooth @ self.turn, _facing(normal, view)
        return SurfacePoints(position, start, smooth, normal, view, place, self.parts[hits.triangle])

    def _face(self, smooth: F32, normals: list[F32], corners: list[F32], view: F32) -> None:
        """Flip normals in place where the surface is seen from behind."""
        away = np.flatnonzero(dot(smooth, view) < 0)
        first, second, third = (corner[away] for corner in corners)
        back = away[dot(np.cross(second - first, third - first), view[away]) < 0]
        for vectors in (smooth, *normals):
            vectors[back] *= -1


def _blend(weights: tuple[F32, ...], values: list[F32]) -> F32:
    a, b, c = (weight * value for weight, value in zip(weights, values, strict=True))
    return a + b + c


def _facing(normals: F32, view: F32) -> F32:
    """Unit normals, bent towards the viewer if they face away."""
    cosine = dot(normals, view)
    away = np.flatnonzero(cosine < MIN_FACING)
    if len(away):
        normals[away] = normalised(normals[away] + (MIN_FACING - cosine[away])[:, None] * view[away])
    return normals
