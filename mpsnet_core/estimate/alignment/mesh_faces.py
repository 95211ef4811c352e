"""A mesh prepared for alignment: face normals and ray casting."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh, triangle_normals
from mpsnet_core.scene.rays import RayScene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeshFaces:
    """A mesh prepared for alignment."""

    scene: RayScene
    """The mesh for ray casting, in world space."""
    normals: NDArray[np.float64]
    """(T, 3). Unit normals of the triangles in world space; zero for triangles without area."""
    axes: NDArray[np.float64]
    """(3, 3). Principal axes of the surface as rows, unit vectors in world space."""

    @classmethod
    def of(cls, mesh: Mesh) -> "MeshFaces":
        corners = mesh.world_vertices[mesh.triangles]
        across = triangle_normals(corners)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        offset = corners.mean(axis=1)
        offset -= (length * offset).sum(axis=0) / max(length.sum(), 1e-300)
        _, axes = np.linalg.eigh((length * offset).T @ offset)
        return cls(RayScene.of(mesh), across / np.where(length > 0, length, 1), axes.T)

    def seen(self, camera: Camera, x: Floats, y: Floats) -> "SeenFaces":
        """What a camera sees at the pixels of columns x (w,) and rows y (h,)."""
        pixels = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1).reshape(-1, 2)
        origins, directions = camera.rays(pixels)
        hits = self.scene.hits(origins, directions)
        found, own = hits.triangle >= 0, directions @ camera.rotation
        normals, points = np.zeros((len(pixels), 3), np.float32), np.zeros((len(pixels), 3))
        normals[found] = self.normals[hits.triangle[found]] @ camera.rotation
        # Flip faces seen from behind: the mesh may be open or wound inwards.
        normals[(normals * own).sum(axis=1) > 0] *= -1
        points[found] = own[found] * (hits.distance[found, None] / self.scene.size)
        shape = (len(y), len(x))
        return SeenFaces(found.reshape(shape), normals.reshape(*shape, 3), points.reshape(*shape, 3))


@dataclass(frozen=True)
class SeenFaces:
    """A mesh as a camera sees it."""

    mask: NDArray[np.bool_]
    """(h, w). Whether a pixel shows the mesh."""
    normals: NDArray[np.float32]
    """(h, w, 3). Unit normals in camera space, facing the camera; zero outside the mask."""
    points: Floats
    """(h, w, 3). Positions in camera space, in units of the mesh's size; zero outside the mask."""
