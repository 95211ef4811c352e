"""A closed shape without symmetry that a formula gives: its mesh, and photos of it that no mesh or ray caster makes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core import Camera, published_rig
from mpsnet_core.scene.mesh import Mesh, shared_normals

BUMPS = np.array(  # direction, height, narrowness
    [
        [1.0, 0.2, 0.1, 0.5, 6.0],
        [-0.6, 0.7, 0.3, 0.35, 10.0],
        [0.1, -0.8, 0.6, 0.3, 14.0],
        [0.2, 0.5, -0.9, 0.45, 8.0],
        [-0.5, -0.4, -0.7, -0.25, 12.0],
        [0.6, 0.6, 0.6, -0.2, 20.0],
        [-0.9, -0.1, 0.4, 0.2, 30.0],
        [0.5, -0.7, -0.3, 0.15, 40.0],
    ]
)
# Left (y) and right look alike but for the last bump.
NEARLY_SYMMETRIC = np.array(
    [
        [1.0, 0.0, 0.1, 0.5, 6.0],
        [0.2, 0.8, 0.6, 0.3, 10.0],
        [0.2, -0.8, 0.6, 0.3, 10.0],
        [-0.5, 0.0, 0.9, 0.35, 8.0],
        [0.0, 0.0, -1.0, 0.5, 5.0],
        [0.7, 0.5, -0.3, 0.2, 14.0],
        [0.7, -0.5, -0.3, 0.2, 14.0],
        [0.7, 0.4, 0.5, 0.06, 60.0],
    ]
)
SIZE = 3.0  # about its diagonal


def radius(directions: NDArray[np.float64], bumps: NDArray[np.float64] = BUMPS) -> NDArray[np.float64]:
    """How far the surface is from the origin along unit directions (..., 3)."""
    axes = bumps[:, :3] / np.linalg.norm(bumps[:, :3], axis=1, keepdims=True)
    found: NDArray[np.float64] = 0.7 + (bumps[:, 3] * np.exp(bumps[:, 4] * (directions @ axes.T - 1))).sum(axis=-1)
    return found


def mesh(rows: int = 80, bumps: NDArray[np.float64] = BUMPS) -> Mesh:
    """Its triangles, on a grid of longitudes and latitudes."""
    latitude = np.linspace(0, np.pi, rows + 1)
    longitude = np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False)
    sine = np.sin(latitude)[:, None]
    grid = np.stack(
        [sine * np.cos(longitude), sine * np.sin(longitude), np.repeat(np.cos(latitude)[:, None], 2 * rows, 1)], axis=-1
    )
    vertices = (grid * radius(grid, bumps)[..., None]).reshape(-1, 3)
    a = np.arange(rows)[:, None] * 2 * rows + np.arange(2 * rows)
    b = np.arange(rows)[:, None] * 2 * rows + (np.arange(2 * rows) + 1) % (2 * rows)
    c, d = a + 2 * rows, b + 2 * rows
    triangles = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    triangles = triangles.astype(np.int32)
    normals = shared_normals(vertices[triangles], triangles).astype(np.float32)
    return Mesh(vertices, triangles, normals, np.zeros((len(triangles), 3, 2), np.float32))


@dataclass(frozen=True)
class Photo:
    """A photo of it. normals: (H, W, 3) in camera space. image: (H, W, 3) matt grey under `published_rig(30, 90)`."""

    camera: Camera
    normals: NDArray[np.float32]
    mask: NDArray[np.bool_]
    image: NDArray[np.float32]


def photo(camera: Camera, bumps: NDArray[np.float64] = BUMPS) -> Photo:
    """What a camera sees, by marching along each ray."""
    x, y = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    pixels = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1).reshape(-1, 2)
    origins, directions = camera.rays(pixels)
    nearest = -(origins * directions).sum(axis=1)  # to the origin, around which the surface lies within 1.6
    mask = np.linalg.norm(origins + nearest[:, None] * directions, axis=1) < 1.6
    origins, directions, nearest = origins[mask], directions[mask], nearest[mask]
    distance = np.maximum(nearest - 1.6, 0)
    marching = np.arange(len(distance))
    for _ in range(250):
        points = origins[marching] + distance[marching, None] * directions[marching]
        step = np.minimum(0.35 * _outside(points, bumps), 0.2)
        distance[marching] += step
        marching = marching[(np.abs(step) > 1e-7) & (distance[marching] < nearest[marching] + 1.6)]
    points = origins + distance[:, None] * directions
    met = np.abs(_outside(points, bumps)) < 1e-3
    mask[mask] = met
    step = 1e-5 * np.eye(3)
    gradient = np.stack([_outside(points[met] + d, bumps) - _outside(points[met] - d, bumps) for d in step], axis=-1)
    normals = np.zeros((len(mask), 3))
    normals[mask] = gradient / np.linalg.norm(gradient, axis=1, keepdims=True) @ camera.rotation
    image = 0.6 * np.maximum(normals @ published_rig(30, 90).directions.T, 0)
    shape = (camera.height, camera.width)
    return Photo(
        camera,
        normals.reshape(*shape, 3).astype(np.float32),
        mask.reshape(shape),
        image.reshape(*shape, 3).astype(np.float32),
    )


def _outside(points: NDArray[np.float64], bumps: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(points, axis=-1)
    found: NDArray[np.float64] = length - radius(points / length[..., None], bumps)
    return found
