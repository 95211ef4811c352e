"""Ambient occlusion: bowls and grooves whose open share is known in closed form, and rays against the mesh."""

import numpy as np
import pytest
from height_shapes import Surface, ball, bowl, bumps, orthographic, plane
from surface_shapes import grid_triangles

from mpsnet_core import Camera, HeightMap, NormalMap, ambient_occlusion
from mpsnet_core.scene.rays import RayScene

NEAR = Camera("perspective", 200, 180, (240.0, 260.0), (90.0, 100.0))
FAR = orthographic(180, 200, 60)
CAMERAS = pytest.mark.parametrize("camera", [FAR, NEAR], ids=["from afar", "from near"])


def of(relief: Surface, reach: int | None = None) -> np.ndarray:
    return ambient_occlusion(relief.heights, relief.normals, reach=reach)


@CAMERAS
def test_nothing_hides_the_sky_from_planes_and_balls(camera: Camera) -> None:
    assert of(plane(camera, (-0.8, 0.5, 1), -4)).min() > 0.9999
    surface = ball(camera, (0.1, -0.2, -5), 1.2)
    found = of(surface)
    assert found[surface.mask].min() > 0.998
    assert (found[~surface.mask] == 1).all()


@CAMERAS
def test_in_a_bowl_all_points_see_the_same_share_of_the_sky(camera: Camera) -> None:
    """From inside a sphere every patch of it is seen under the same share: its area by that of the sphere. The bowl is
    a cap to 60° from its axis, a quarter of the sphere."""
    surface = bowl(camera, (0.1, -0.1, -4), 1.3)
    found = of(surface)[surface.mask]
    assert found.mean() == pytest.approx(0.75, abs=0.008)
    assert np.abs(found - 0.75).max() < 0.018


def test_a_groove_of_a_right_angle() -> None:
    """On its walls at t from the bottom, of w, the open share is (1 + t / sqrt(t² + w²)) / 2 where it is long."""
    wide, long = 81, 1601
    x = np.broadcast_to(np.arange(wide) - wide // 2, (long, wide)).astype(float)
    mask = np.ones(x.shape, bool)
    normals = NormalMap(np.stack([-np.sign(x), 0 * x, 1 + 0 * x], axis=-1), mask)
    found = ambient_occlusion(HeightMap(np.abs(x), mask, orthographic(long, wide)), normals)[long // 2]
    t = np.abs(x[0])
    expected = (1 + t / np.hypot(t, wide // 2)) / 2
    assert np.abs(found - expected)[t > 0].max() < 0.02


def level(z: np.ndarray, reach: int | None = None) -> np.ndarray:
    """Of upright steps, which no normal shows: all is level."""
    up = NormalMap(np.tile([0.0, 0, 1], (*z.shape, 1)), np.ones(z.shape, bool))
    return ambient_occlusion(HeightMap(z, up.mask, orthographic(*z.shape)), up, reach=reach)


def test_the_foot_of_a_long_wall() -> None:
    """At t from a wall of height h it hides (1 - t / sqrt(t² + h²)) / 2; it stands between the pixels at -1 and 0."""
    long, high = 801, 50
    x = np.arange(-60.0, 140)
    found = level(np.broadcast_to(np.where(x < 0, high, 0.0), (long, len(x))))[long // 2]
    t = x[x >= 0]
    least, most = ((1 + away / np.hypot(away, high)) / 2 for away in (t, t + 1))
    assert (found[x >= 0] > least - 0.002).all() and (found[x >= 0] < most + 0.01).all()
    assert found[x < 0].min() > 0.99


def beside_disc(distance: float, radius: float, height: float) -> float:
    """What is open at a distance from the axis of an upright cylinder: of each azimuth 1 - sin² of its elevation."""
    half = np.arcsin(radius / distance)
    azimuth = (np.arange(10_000) + 0.5) / 10_000 * half
    away = distance * np.cos(azimuth) - np.sqrt(radius**2 - (distance * np.sin(azimuth)) ** 2)
    return float(1 - half / np.pi * np.mean(height**2 / (height**2 + away**2)))


def test_a_tall_disc_casts_no_straight_shadows() -> None:
    """All around it, it is as light as its distance says, and not in rays, one to each direction that is looked in."""
    y, x = np.mgrid[-90:91, -90:91]
    away = np.hypot(x - 0.3, y + 0.2)
    found = level(np.where(away < 20, 80.0, 0.0))
    for distance, spread in ((26, 0.008), (40, 0.005), (60, 0.004), (80, 0.003)):
        ring = found[np.abs(away - distance) < 0.5]
        assert ring.mean() == pytest.approx(beside_disc(distance, 20, 80), abs=0.006)
        assert ring.std() < spread
    assert found[away < 20].min() > 0.99


def test_pictures_smaller_than_a_block() -> None:
    """One row or column of pixels, with a wall at its end."""
    row = np.zeros((1, 7))
    row[0, 0] = 5
    found = level(row)
    assert 0.5 < found[0, 1] < found[0, 6] < 1 and found[0, 0] > 0.9
    assert pytest.approx(found, abs=0.06) == level(row.T).T


@CAMERAS
def test_rays_against_the_mesh_say_the_same(camera: Camera) -> None:
    surface = bumps(camera, depth=4, size=2)
    points = surface.heights.points().reshape(-1, 3)
    scene = RayScene(points, grid_triangles(*surface.mask.shape))
    rng = np.random.default_rng(5)
    rows, columns = rng.integers(20, 160, 300), rng.integers(20, 180, 300)
    chosen = rows * camera.width + columns
    normals = surface.normals.vectors[rows, columns].astype(float)
    share = np.zeros(len(chosen))
    rounds = 1000
    for _ in range(rounds):
        # A point on a unit sphere around the normal's tip: directions by their cosine.
        sphere = rng.normal(size=normals.shape)
        direction = normals + sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        share += ~scene.occluded(points[chosen] + 2e-3 * normals, direction)
    found, expected = of(surface)[rows, columns], share / rounds
    assert expected.min() < 0.75 and expected.max() > 0.95
    assert np.abs(found - expected).mean() < 0.015
    assert np.abs(found - expected).max() < 0.06


def test_a_short_reach_sees_only_what_is_near() -> None:
    surface = bowl(FAR, (0, 0, -4), 1.3)
    near, far = of(surface, reach=3), of(surface)
    assert near[surface.mask].mean() > far[surface.mask].mean() + 0.1
    assert of(surface, reach=10_000) == pytest.approx(far)


def test_what_is_beside_the_mask_hides_nothing() -> None:
    """A wall that is not part of the object."""
    x = np.broadcast_to(np.arange(40.0), (40, 40))
    wall = np.where(x < 20, 0, 30.0)
    up = NormalMap(np.tile([0.0, 0, 1], (40, 40, 1)), np.ones((40, 40), bool))
    camera = orthographic(40, 40)
    assert ambient_occlusion(HeightMap(wall, up.mask, camera), up)[20, 18] < 0.6
    assert ambient_occlusion(HeightMap(wall, x < 20, camera), up)[20, 18] == 1
