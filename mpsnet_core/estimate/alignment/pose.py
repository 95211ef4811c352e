"""Pinhole cameras with seven parameters, and derivatives of their projections."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.types import F32, F64, Bools, Indices
from mpsnet_core.arrays.unit_vectors import cross_matrix, quaternion_matrix, rotation_matrices
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh, triangle_normals
from mpsnet_core.scene.rays import RayScene

# Rotation vector, translation, logarithm of the focal length.
PARAMETERS = 7


@dataclass(frozen=True)
class Poses:
    """K pinhole cameras with square pixels and the same principal point."""

    rotation: F64
    """(K, 3, 3). Rotations from world to camera space: x right, y up, z towards the viewer."""
    translation: F64
    """(K, 3). Translations from world to camera space."""
    focal: F64
    """(K,). Focal lengths in pixels."""
    centre: F64
    """(2,). Principal point, in pixels from the top left corner."""

    @classmethod
    def of(cls, camera: Camera) -> "Poses":
        """The pose of a camera (K = 1). An orthographic camera becomes a distant perspective one."""
        world = np.linalg.inv(camera.world_from_camera).astype(np.float64, copy=False)
        return cls(world[None, :3, :3], world[None, :3, 3], camera.focal[:1].copy(), camera.centre)

    def subset(self, which: Indices) -> "Poses":
        return Poses(self.rotation[which], self.translation[which], self.focal[which], self.centre)

    def camera(self, width: int, height: int, which: int = 0) -> Camera:
        """One of them as a camera with this image size."""
        left, _, right = np.linalg.svd(self.rotation[which])
        pose = np.eye(4)
        pose[:3, :3] = (left @ right).T
        pose[:3, 3] = -pose[:3, :3] @ self.translation[which]
        return Camera("perspective", width, height, np.full(2, self.focal[which]), self.centre, pose)

    def moved(self, step: F64) -> "Poses":
        """The poses after steps (K, 7) of the parameters."""
        turn = rotation_matrices(step[:, :3])
        return Poses(
            turn @ self.rotation,
            np.einsum("kij,kj->ki", turn, self.translation) + step[:, 3:6],
            self.focal * np.exp(step[:, 6]),
            self.centre,
        )

    def in_camera(self, points: F64) -> F64:
        """(K, N, 3) world points (N, 3) in camera space."""
        return points @ self.rotation.transpose(0, 2, 1) + self.translation[:, None]

    def projected(self, seen: F64) -> F64:
        """(K, N, 2) pixels of points (K, N, 3) in camera space."""
        return self.centre + self.focal[:, None, None] * seen[..., :2] * (1, -1) / depth(seen)[..., None]


def depth(seen: F64) -> F64:
    """Depth of points (..., 3) in camera space in front of the camera, clamped to a small positive value."""
    return np.maximum(-seen[..., 2], 1e-9)


def flow(seen: F64, focal: F64) -> F64:
    """(..., 2, 7) derivatives of the pixels of points (..., 3) in camera space by the parameters. focal: (...)."""
    x, y, z = seen[..., 0], seen[..., 1], depth(seen)
    by_point = np.zeros((*seen.shape[:-1], 2, 3))
    by_point[..., 0, 0] = by_point[..., 1, 1] = focal / z
    by_point[..., 1, 1] *= -1
    by_point[..., 0, 2] = focal * x / z**2
    by_point[..., 1, 2] = -focal * y / z**2
    result = np.empty((*seen.shape[:-1], 2, PARAMETERS))
    result[..., :3] = by_point @ -cross_matrix(seen)
    result[..., 3:6] = by_point
    result[..., 0, 6], result[..., 1, 6] = focal * x / z, -focal * y / z
    return result


def spread_rotations(count: int) -> F64:
    """(count, 3, 3) rotations that cover SO(3) evenly (Alexa, "Super-Fibonacci Spirals", CVPR 2022)."""
    number = np.arange(count) + 0.5
    share = number / count
    alpha, beta = 2 * np.pi * number / np.sqrt(2.0), 2 * np.pi * number / 1.533751168755204288118041
    w, x = np.sqrt(share) * np.sin(alpha), np.sqrt(share) * np.cos(alpha)
    y, z = np.sqrt(1 - share) * np.sin(beta), np.sqrt(1 - share) * np.cos(beta)
    return np.array(quaternion_matrix(w, x, y, z)).transpose(2, 0, 1)


# --- A mesh prepared for alignment: face normals and ray casting ------------------------------------------------------


@dataclass(frozen=True)
class MeshFaces:
    """A mesh prepared for alignment."""

    scene: RayScene
    """The mesh for ray casting, in world space."""
    normals: F64
    """(T, 3). Unit normals of the triangles in world space; zero for triangles without area."""
    axes: F64
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

    def seen(self, camera: Camera, x: F64, y: F64) -> "SeenFaces":
        """What a camera sees at the pixels of columns x (w,) and rows y (h,)."""
        shape = len(y), len(x)
        mask, normals, points = np.zeros(shape, bool), np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3))
        rows, columns = (
            slice(*np.searchsorted(places, (part.start, part.stop)))
            for places, part in zip((y, x), self.scene.extent(camera), strict=True)
        )
        # As Camera.rays, but in float32 and from one origin: half the time.
        right = ((x[columns] - camera.centre[0]) / camera.focal[0]).astype(np.float32)
        up = ((camera.centre[1] - y[rows, None]) / camera.focal[1]).astype(np.float32)
        length = np.sqrt(right**2 + up**2 + 1)
        own = np.stack([right / length, up / length, -1 / length], axis=-1).reshape(-1, 3)
        origin = np.broadcast_to(camera.world_from_camera[:3, 3], own.shape)
        hits = self.scene.hits(origin, own @ camera.rotation.T.astype(np.float32))
        found = hits.triangle >= 0
        own = own[found]
        facing = self.normals[hits.triangle[found]] @ camera.rotation
        # Flip faces seen from behind: the mesh may be open or wound inwards.
        facing[(facing * own).sum(axis=1) > 0] *= -1
        mask[rows, columns] = inside = found.reshape(length.shape)
        normals[rows, columns][inside] = facing
        points[rows, columns][inside] = own * (hits.distance[found, None] / self.scene.size)
        return SeenFaces(mask, normals, points)


@dataclass(frozen=True)
class SeenFaces:
    """A mesh as a camera sees it."""

    mask: Bools
    """(h, w). Whether a pixel shows the mesh."""
    normals: F32
    """(h, w, 3). Unit normals in camera space, facing the camera; zero outside the mask."""
    points: F64
    """(h, w, 3). Positions in camera space, in units of the mesh's size; zero outside the mask."""
