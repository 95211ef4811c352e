"""A mesh seen through a camera's pixels: the points that rays hit, and interpolated values there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene


@dataclass(frozen=True)
class MeshHits:
    """The hits of a camera's rays through N pixels on a mesh."""

    mesh: Mesh
    """The mesh."""
    camera: Camera
    """The camera."""
    hit: I64
    """(M,). Indices of the pixels whose rays hit the mesh."""
    triangle: I32
    """(M,). Triangles that they hit."""
    weights: F32
    """(M, 3, 1). Barycentric coordinates of the hits."""
    points: F64
    """(M, 3). The hits in world space, relative to the scene's centre."""
    directions: F64
    """(M, 3). Unit directions of the rays, in camera space."""

    def at(self, corners: Floats) -> NDArray[Any]:
        """(M, K) values at the hits, interpolated from those at the triangles' corners, (T, 3, K)."""
        values: Floats = (corners[self.triangle] * self.weights).sum(axis=1)
        return values

    def in_camera(self, normals: F32) -> F32:
        """(M, 3) unit normals in camera space from normals (M, 3) in object space."""
        to_camera = self.mesh.normals_to_world @ self.camera.rotation
        unit: F32 = normalised(normals @ to_camera.astype(np.float32))
        return unit

    @property
    def from_front(self) -> Bools:
        """(M,) whether the triangles' outsides face the camera."""
        facing: Bools = dot(self.mesh.outwards[self.triangle] @ self.camera.rotation, self.directions) < 0
        return facing


def mesh_hits(mesh: Mesh, camera: Camera, scene: RayScene, pixels: Floats) -> MeshHits:
    """Cast a camera's rays through pixels (N, 2) onto the mesh. scene: of the same mesh."""
    origins, directions, _ = scene.rays_of(camera, pixels)
    hits = scene.hits(origins, directions)
    hit = np.flatnonzero(hits.triangle >= 0)
    hits = hits.subset(hit)
    points = origins[hit] - scene.middle + directions[hit] * hits.distance[:, None]
    return MeshHits(mesh, camera, hit, hits.triangle, hits.weights, points, directions[hit] @ camera.rotation)
