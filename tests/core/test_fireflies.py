"""Fireflies in a render: gone before a network sees the photo, while highlights stay as they are."""

import numpy as np
import pytest
from synthetic import Sphere, degrees_between, shaded_sphere

from mpsnet_core.estimate.estimator import estimate_normals, remove_fireflies


@pytest.fixture(scope="module")
def painted() -> Sphere:
    """In colours that vary, so that the network has to tell them from shape."""
    sphere = shaded_sphere(64)
    x, y = np.meshgrid(np.linspace(0, 9, 64), np.linspace(0, 7, 64))
    paint = np.dstack([0.5 + 0.3 * np.sin(x + k) * np.cos(y + 2 * k) for k in range(3)])
    return Sphere((sphere.image * paint).astype(np.float32), sphere.normals, sphere.mask, sphere.lit, sphere.rig)


def error(sphere: Sphere, image: np.ndarray) -> float:
    normals = estimate_normals(sphere.capture(image=image), passes=1)
    return float(degrees_between(normals.vectors, sphere.normals)[sphere.mask].mean())


@pytest.mark.parametrize("count", [1, 10, 100])
def test_fireflies_do_not_mislead_the_network(painted: Sphere, count: int) -> None:
    draw = np.random.default_rng(count)
    places = draw.choice(np.argwhere(painted.mask), count, replace=False)
    image = painted.image.copy()
    image[tuple(places.T)] = 1000 * draw.random((count, 3))
    assert error(painted, image) == pytest.approx(error(painted, painted.image), abs=0.5)


@pytest.mark.parametrize("places", [[(0, 0)], [(31, 0)], [(0, 47)], [(9, 9), (9, 10), (10, 9)]])
@pytest.mark.parametrize("channels", [[1], [0, 1, 2]])
@pytest.mark.parametrize("kind", [np.float32, np.float16])
def test_a_firefly_becomes_as_its_surroundings(sphere, places: list[tuple[int, int]], channels: list[int], kind: type):
    """In corners, at the border and among others too; a capture of one colour, so what it becomes is known."""
    plain = np.full((32, 48, 3), (0.5, 0.25, 0.125), kind)
    image = plain.copy()
    for row, column in places:
        image[row, column, channels] = 1000
    found = remove_fireflies(sphere.capture(image=image, mask=np.ones((32, 48), bool))).image
    np.testing.assert_array_equal(found, plain)
    assert found.dtype == kind and image.max() == 1000


@pytest.mark.parametrize("peak", [5.0, 500.0])
def test_highlights_of_a_render_stay(painted: Sphere, peak: float) -> None:
    halves = painted.rig.directions + np.array([0, 0, 1])
    cosines = painted.normals @ (halves / np.linalg.norm(halves, axis=1, keepdims=True)).T
    image = (painted.image + peak * np.maximum(cosines, 0) ** 800).astype(np.float32)
    capture = painted.capture(image=image)
    assert remove_fireflies(capture) is capture


@pytest.mark.parametrize("sensor", [{"clip": 1.0}, {"clipped": np.zeros((64, 64, 3), bool)}], ids=["file", "raw"])
def test_a_photograph_stays(painted: Sphere, sensor: dict[str, object]) -> None:
    """What stands out there is paint or a hot pixel, and at most as bright as the sensor's end."""
    image = 0.1 * painted.image
    image[30, 30] = 0.9
    capture = painted.capture(image=image, **sensor)
    assert remove_fireflies(capture) is capture
