"""Rays against spheres by their equation, and against triangles by barycentric coordinates."""

import numpy as np
import pytest
from surface_shapes import sphere_mesh

from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene

PLACE = np.array([5.0, -3.0, 40.0])
SIZE = 7.0


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """A ball of radius SIZE, far from the origin."""
    pose = np.diag([SIZE, SIZE, SIZE, 1.0])
    pose[:3, 3] = PLACE
    return sphere_mesh(96, 48, world_from_object=pose)


@pytest.fixture(scope="module")
def rays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins 30 away from the ball's middle, unit directions, and how far the rays pass from the middle."""
    rng = np.random.default_rng(3)
    outwards = rng.normal(size=(3000, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    origins = PLACE + 30 * outwards
    directions = PLACE + rng.normal(0, 6, (3000, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    along = ((PLACE - origins) * directions).sum(1)
    return origins, directions, np.linalg.norm(origins + along[:, None] * directions - PLACE, axis=1)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_hits_lie_on_the_ray_and_in_the_triangle(mesh: Mesh, rays: tuple[np.ndarray, ...], kind: type) -> None:
    origins, directions, passing = rays
    hits = RayScene.of(mesh).hits(origins.astype(kind), directions.astype(kind))
    hit = hits.triangle >= 0
    assert 0.3 < hit.mean() < 0.9
    sure = np.abs(passing - SIZE) > 0.01 * SIZE
    assert (hit == (passing < SIZE))[sure].all()
    assert (np.isfinite(hits.distance) == hit).all()
    u, v = hits.u[hit, None], hits.v[hit, None]
    assert u.min() > -1e-5 and v.min() > -1e-5 and (u + v).max() < 1 + 1e-5
    first, second, third = np.moveaxis(mesh.world_vertices[mesh.triangles[hits.triangle[hit]]], 1, 0)
    in_triangle = (1 - u - v) * first + u * second + v * third
    on_ray = origins[hit] + hits.distance[hit, None] * directions[hit]
    assert np.abs(in_triangle - on_ray).max() < 2e-4
    assert ((on_ray - PLACE) * directions[hit]).sum(1).max() < 0.1 * SIZE  # the near side of the ball


def test_occluded_is_whether_anything_is_hit(mesh: Mesh, rays: tuple[np.ndarray, ...]) -> None:
    origins, directions, passing = rays
    scene = RayScene.of(mesh)
    assert (scene.occluded(origins, directions) == (scene.hits(origins, directions).triangle >= 0)).all()
    sure = np.abs(passing - SIZE) > 0.01 * SIZE
    assert (scene.occluded(origins, directions) == (passing < SIZE))[sure].all()
    down = np.array([[0.0, 0.0, -1.0]])
    towards = np.broadcast_to(down, origins.shape)
    shared = scene.occluded(origins, down)
    assert 0 < shared.mean() < 1 and (shared == scene.occluded(origins, towards)).all()
