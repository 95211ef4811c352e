"""Where one thing stands before another: what the fast method smears and the bilateral one keeps."""

from collections.abc import Callable

import numpy as np
import pytest
from height_shapes import Surface, off, square_camera, torus, two_spheres

from mpsnet_core import Camera, NormalMap, ambient_occlusion
from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.relief.integration.integrate import METHODS, Method, integrate

pytestmark = pytest.mark.accuracy


def beside_steps(surface: Surface, least: float, reach: int) -> np.ndarray:
    """The mask's pixels within `reach` of a step of more than `least` between neighbours."""
    z, mask = surface.z, surface.mask
    steps = np.zeros(mask.shape, bool)
    across = (np.abs(np.diff(z, axis=1)) > least) & mask[:, 1:] & mask[:, :-1]
    along = (np.abs(np.diff(z, axis=0)) > least) & mask[1:] & mask[:-1]
    steps[:, 1:] |= across
    steps[1:] |= along
    return dilated(steps, reach) & mask


def errors(surface: Surface, method: Method) -> np.ndarray:
    """(H, W) in pixels, 0 outside the mask."""
    away = np.zeros(surface.mask.shape)
    values = integrate(surface.normals, surface.camera, method=method).values
    away[surface.mask] = off(values, surface.z, surface.mask) * surface.camera.focal[0]
    return away


@pytest.mark.parametrize(
    ("shape", "times"),
    [(lambda: two_spheres(square_camera(192)), 1.5), (lambda: torus(192, 65), 1.5), (lambda: torus(192, 75), 10)],
    ids=["two spheres", "a ring that hides a little of itself", "a ring that hides much of itself"],
)
def test_bilateral_keeps_steps(shape: Callable[[], Surface], times: float) -> None:
    """Parts that hang together elsewhere stand at their true distance from each other, up to the step's very edge."""
    surface = shape()
    near = beside_steps(surface, 8 / 96, 6)
    fast, bilateral = errors(surface, "fast"), errors(surface, "bilateral")
    assert near.sum() > 300
    assert fast[near].mean() > times * bilateral[near].mean()
    assert fast[surface.mask].mean() > 2 * bilateral[surface.mask].mean()
    assert bilateral[surface.mask].mean() < 1


def test_bilateral_steps_are_narrow() -> None:
    """Of the steps along a ring that hides itself the middle one rises to 9/10 over three pixels; smeared, a third."""
    ring = torus(192, 75)
    share = {}
    for method in METHODS:
        heights = integrate(ring.normals, ring.camera, method=method).values
        steps, rows, columns = [], *np.nonzero(beside_steps(ring, 20 / 96, 0))
        for row, column in zip(rows, columns, strict=True):
            line = slice(row - 2, row + 2)
            if 2 < row < 189 and ring.mask[line, column].all():
                true = np.ptp(ring.z[line, column])
                steps.append(abs(heights[row - 2, column] - heights[row + 1, column]) / true)
        share[method] = np.median(steps)
    assert share["bilateral"] > 0.9 and share["fast"] < 0.4


def test_steps_of_large_pictures_are_where_they_are() -> None:
    """Not in blocks of the smaller pictures that it is begun with, nor is the occlusion that these heights tell."""
    camera = Camera("orthographic", 640, 240, [320.0, 320.0], [320.0, 195.0])
    true = two_spheres(camera)
    heights = integrate(true.normals, camera, method="bilateral")
    found = Surface(true.normals, heights.values, camera)
    high, half, low = (step / 320 for step in (24, 12, 6))
    steps = beside_steps(true, high, 0)
    assert steps.sum() > 40
    assert beside_steps(found, half, 1)[steps].mean() > 0.97
    assert beside_steps(true, low, 1)[beside_steps(found, half, 0)].mean() > 0.99
    near = beside_steps(true, high, 4)
    occlusions = [ambient_occlusion(of, true.normals, reach=40)[near] for of in (heights, true.heights)]
    assert np.abs(np.subtract(*occlusions)).mean() < 0.02


def test_pixels_between_two_surfaces_tie_neither_to_the_other() -> None:
    """Steep pixels at a step's rim hang half way: each pulls little, but all of them move a ring's arm by pixels."""
    ring = torus(256, 72)
    assert errors(ring, "bilateral")[ring.mask].mean() < 0.8


@pytest.mark.parametrize("size", [300, 384])
def test_pictures_that_a_smaller_one_begins_are_as_right_as_it_is(size: int) -> None:
    """To a third of a pixel; twice as much while what ties both sides of a break a little counted in every pass."""
    balls = two_spheres(square_camera(size))
    assert errors(balls, "bilateral")[balls.mask].mean() < 0.35


def blurred(values: np.ndarray, times: int) -> np.ndarray:
    for axis in (0, 1) * times:
        values = (np.roll(values, 1, axis) + values + np.roll(values, -1, axis)) / 3
    return values


@pytest.mark.long
def test_normals_that_are_blurred_and_noisy_tear_little() -> None:
    """As long as links were cut for good in the first passes, this ring came apart: by 36 pixels on the mean."""
    ring = torus(384, 70)
    found = []
    for seed in range(2):
        noise = blurred(np.random.default_rng(seed).normal(size=ring.normals.vectors.shape), 8)
        vectors = blurred(ring.normals.vectors * ring.mask[..., None], 2) + 0.1 * noise / noise.std()
        noisy = Surface(NormalMap(normalised(vectors), ring.mask), ring.z, ring.camera)
        found.append(errors(noisy, "bilateral")[ring.mask].mean())
    assert np.mean(found) < 30


@pytest.mark.parametrize("method", METHODS)
def test_perspective_keeps_steps_as_well(method: Method) -> None:
    """The same ring before a long lens, seen from afar: what it is orthographically, but for the lens."""
    ring = torus(128, 65)
    far = Camera("perspective", 128, 128, ring.camera.focal * 200)
    values = integrate(ring.normals, far, method=method, distance=200.0).values
    flat = integrate(ring.normals, ring.camera, method=method).values
    assert off(values, flat, ring.mask).mean() * 64 < 0.3


def test_what_does_not_fit_together_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast method, beside plain least squares (loops that do not close count in full), away from the steps."""
    surface = two_spheres(square_camera(192))
    away = surface.mask & ~beside_steps(surface, 4 / 96, 12)
    error = errors(surface, "fast")[away].mean()
    monkeypatch.setattr("mpsnet_core.relief.integration.integrate.LOOSE", np.float32(1e9))
    assert error < errors(surface, "fast")[away].mean() / 2
