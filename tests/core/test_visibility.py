"""Visibility against rays that are intersected with every triangle, where surfaces hide one another."""

import numpy as np
import pytest
from surface_shapes import camera_looking, sphere_mesh, towards_camera

from mpsnet_core import Camera, Mesh
from mpsnet_core.scene.rays import RayScene, Visibility

pytestmark = pytest.mark.accuracy

VIEWS = [((1, 0.2, 0.1), "orthographic"), ((-0.3, 1, 0.4), "perspective"), ((-0.8, -0.3, -0.4), "perspective")]


def hidden_ring() -> Mesh:
    """A torus around a sphere, with another sphere behind: from the side, each hides parts of the others."""
    sphere = sphere_mesh(20, 10)
    ring, tube = np.mgrid[:32, :12] * np.array([2 * np.pi / 32, 2 * np.pi / 12])[:, None, None]
    away = 1.6 + 0.35 * np.cos(tube)
    torus = np.stack([away * np.cos(ring), away * np.sin(ring), 0.35 * np.sin(tube)], axis=-1).reshape(-1, 3)
    i, j = np.mgrid[:32, :12]

    def number(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % 32) * 12 + j % 12

    quads = np.stack([number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)], -1).reshape(-1, 4)
    parts = [
        (sphere.vertices, sphere.triangles),
        (torus, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])),
        (0.5 * sphere.vertices + (2.4, 0.3, 0.8), sphere.triangles),
    ]
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    triangles = np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=True)])
    normals = np.broadcast_to([0, 0, 1], (len(triangles), 3, 3))
    return Mesh(vertices, triangles, normals, np.random.default_rng(0).random((len(triangles), 3, 2)))


def nearest_hit(mesh: Mesh, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) the distance to the first triangle beyond 1e-6, by Cramer's rule on every triangle."""
    a, b, c = np.moveaxis(mesh.world_vertices[mesh.triangles], 1, 0)
    nearest = np.full(len(origins), np.inf)
    for corner, e1, e2 in zip(a, b - a, c - a, strict=True):
        across = np.cross(directions, e2)
        volume = across @ e1
        start = origins - corner
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (start * across).sum(1) / volume
            turned = np.cross(start, e1)
            v = (directions * turned).sum(1) / volume
            distance = turned @ e2 / volume
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 1e-6)
        nearest = np.where(hit, np.minimum(nearest, distance), nearest)
    return nearest


def seen_by(camera: Camera, mesh: Mesh, points: np.ndarray, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """(N,) whether the camera sees points (N, 3) of the world, at `pixels` (N, 2) and `depth` (N,) of its image."""
    scene = RayScene.of(mesh)
    x, y = pixels.T.astype(np.float32)
    depth = (depth - scene.depth_of_middle(camera)).astype(np.float32)
    return Visibility(camera, scene).seen((points - scene.middle).T.astype(np.float32), x, y, depth)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return hidden_ring()


@pytest.mark.parametrize(("direction", "projection"), VIEWS)
def test_what_no_triangle_hides_is_seen(mesh: Mesh, direction: tuple[float, float, float], projection: str) -> None:
    camera = camera_looking(direction, projection, size=300, distance=9, reach=3.2)
    rng = np.random.default_rng(2)
    triangle = rng.integers(0, len(mesh.triangles), 700)
    corners = mesh.world_vertices[mesh.triangles[triangle]]
    points = np.einsum("nc,nci->ni", rng.dirichlet([1, 1, 1], len(triangle)), corners)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = towards_camera(camera, points)
    cosine = (outward * towards).sum(1) / np.linalg.norm(outward, axis=1)
    points, towards = points[cosine > 0.1], towards[cosine > 0.1]

    # Rays that pass a silhouette by less than the ray's own offset may go either way.
    side = np.cross(towards, [0.3, 0.5, 0.8])
    side *= 2e-3 / np.linalg.norm(side, axis=1, keepdims=True)
    shifts = (0 * side, side, -side, np.cross(towards, side), -np.cross(towards, side))
    free = np.array([np.isinf(nearest_hit(mesh, points + 0.025 * towards + shift, towards)) for shift in shifts])
    clear = (free == free[0]).all(axis=0)
    assert clear.mean() > 0.9
    assert 0.1 < free[0].mean() < 0.9
    in_camera = (points - camera.world_from_camera[:3, 3]) @ camera.world_from_camera[:3, :3]
    for size in (300, 1200):
        camera = camera.resized(size, size)
        scale = camera.focal[0] / (-in_camera[:, 2:] if projection == "perspective" else 1)
        pixels = size / 2 + in_camera[:, :2] * scale * (1, -1)
        assert (pixels > 0).all() and (pixels < size).all()
        seen = seen_by(camera, mesh, points, pixels, -in_camera[:, 2])
        assert (seen == free[0])[clear].all(), size
