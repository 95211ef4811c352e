"""A mesh through a camera's pixels: what each ray meets, and what is given there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene


@dataclass(frozen=True)
class MeshSeen:
    """Where a camera's rays through N pixels meet a mesh.

    mesh: the mesh. camera: what sees it. hit: (M,) which of the pixels do. triangle: (M,) what they meet. weights:
    (M, 3, 1) barycentric coordinates. points: (M, 3) in the world, relative to the scene's middle. directions: (M, 3)
    unit, of the rays in camera space.
    """

    mesh: Mesh
    camera: Camera
    hit: NDArray[np.int64]
    triangle: NDArray[np.int32]
    weights: NDArray[np.float32]
    points: NDArray[np.float64]
    directions: NDArray[np.float64]

    def at(self, corners: NDArray[np.floating[Any]]) -> NDArray[Any]:
        """(M, K) values that are given at the corners of triangles, (T, 3, K)."""
        values: NDArray[np.floating[Any]] = (corners[self.triangle] * self.weights).sum(axis=1)
        return values

    def in_camera(self, normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """(M, 3) unit normals in camera space, of normals (M, 3) in object space."""
        to_camera = self.mesh.normals_to_world @ self.camera.rotation
        unit: NDArray[np.float32] = normalised(normals @ to_camera.astype(np.float32))
        return unit

    def from_front(self, normals: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(M,) whether surfaces of these normals (M, 3), in camera space, face the camera."""
        facing: NDArray[np.bool_] = dot(normals, self.directions) < 0
        return facing


def mesh_seen(mesh: Mesh, camera: Camera, scene: RayScene, pixels: NDArray[np.floating[Any]]) -> MeshSeen:
    """What a camera sees of the mesh, of which the scene is, through pixels (N, 2)."""
    origins, directions, _ = scene.rays_of(camera, pixels)
    hits = scene.hits(origins, directions)
    hit = np.flatnonzero(hits.triangle >= 0)
    hits = hits.chosen(hit)
    points = origins[hit] - scene.middle + directions[hit] * hits.distance[:, None]
    return MeshSeen(mesh, camera, hit, hits.triangle, hits.weights, points, directions[hit] @ camera.rotation)
