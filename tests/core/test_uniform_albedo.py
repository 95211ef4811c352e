"""A matt surface of one colour is found in the photo and solved; whatever is none stays as the network has it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from near_scene import DIRECTIONS, NEAR, WIDE, Scene, ball
from synthetic import degrees_between

from mpsnet_core import Capture, NormalMap, estimate_normals
from mpsnet_core.estimate.uniform_albedo import refine, refine_normals

pytestmark = pytest.mark.accuracy

PAINT = np.array([0.9, 0.5, 0.3])
EXPECTED = 8.0  # degrees


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {"distant": ball(None), "wide lens": ball(WIDE), "near lights": ball(50, NEAR)}


def network(scene: Scene) -> NormalMap:
    """Normals that are wrong by waves, and by as much as they expect."""
    y, x = np.mgrid[: len(scene.mask), : len(scene.mask)] / 9.0
    waves = np.stack([np.sin(x + 1), np.cos(y), np.zeros_like(x)], axis=-1)
    confidence = np.full(scene.mask.shape, 1 - EXPECTED / 90, np.float32)
    return NormalMap((scene.normals + 0.2 * waves).astype(np.float32), scene.mask, confidence)


def painted(scene: Scene, paint: np.ndarray = PAINT) -> Capture:
    return scene.capture(image=scene.image * paint)


def errors(estimate: NormalMap, scene: Scene) -> np.ndarray:
    return degrees_between(estimate.vectors, scene.normals)


@pytest.mark.parametrize("name", ["distant", "wide lens", "near lights"])
def test_a_painted_ball_is_solved(name: str, scenes: dict[str, Scene]) -> None:
    scene = scenes[name]
    before, after = network(scene), refine_normals(painted(scene), network(scene))
    assert errors(before, scene)[scene.mask].mean() > 5
    assert errors(after, scene)[scene.lit].mean() < 0.1
    assert 90 * (1 - after.confidence[scene.lit]).mean() < 1.0


@pytest.mark.parametrize("name", ["distant", "near lights"])
def test_where_a_light_does_not_reach_the_others_help(name: str, scenes: dict[str, Scene]) -> None:
    scene = scenes[name]
    before, after = network(scene), refine_normals(painted(scene), network(scene))
    shadow = scene.mask & ~scene.lit
    assert errors(after, scene)[shadow].mean() < 0.2 * errors(before, scene)[shadow].mean()
    assert 90 * (1 - after.confidence[shadow]).mean() == pytest.approx(errors(after, scene)[shadow].mean(), abs=2.0)


def test_a_cast_shadow_of_one_light_is_solved_by_the_two_others(scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    shadow = scene.lit.copy()
    shadow[:, :70], shadow[:, 90:] = False, False
    image = scene.image * PAINT
    image[shadow, 0] = 0
    after = errors(refine_normals(scene.capture(image=image), network(scene)), scene)
    assert after[shadow].mean() < 0.3 * errors(network(scene), scene)[shadow].mean()
    assert after[scene.lit & ~shadow].mean() < 0.3


@pytest.mark.parametrize("name", ["distant", "wide lens", "near lights"])
def test_noise_hides_no_proof(name: str, scenes: dict[str, Scene]) -> None:
    """At full resolution lengths differ by more than any proof allows; at less of it the noise is averaged out."""
    scene = scenes[name]
    noise = np.random.default_rng(1).normal(1, 0.04, scene.image.shape)
    before, after = network(scene), refine_normals(painted(scene, PAINT * noise), network(scene))
    assert errors(before, scene)[scene.lit].mean() > 5
    assert errors(after, scene)[scene.lit].mean() < 2
    assert 90 * (1 - after.confidence[scene.lit]).mean() == pytest.approx(errors(after, scene)[scene.lit].mean(), abs=2)


def test_noise_in_a_proven_colour_is_averaged_out(scenes: dict[str, Scene], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes["distant"]
    capture = painted(scene, PAINT * np.random.default_rng(1).normal(1, 0.015, scene.image.shape))
    mended = refine_normals(capture, network(scene))
    monkeypatch.setattr(refine, "MIN_OBJECT", np.inf)
    alone = refine_normals(capture, network(scene))
    assert errors(alone, scene)[scene.lit].mean() < 3
    assert errors(mended, scene)[scene.lit].mean() < 0.7 * errors(alone, scene)[scene.lit].mean()


def glossy(scene: Scene) -> np.ndarray:
    half = DIRECTIONS + np.array([0, 0, 1])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return scene.image * PAINT + 0.8 * np.maximum(scene.normals @ half.T, 0) ** 12 * (scene.image > 0)


def many_colours(scene: Scene) -> np.ndarray:
    y, x = np.mgrid[: len(scene.mask), : len(scene.mask)] / 11.0
    return scene.image * np.stack([1 + 0.5 * np.sin(x), 1 + 0.5 * np.cos(x + y), 1 + 0.5 * np.sin(y)], axis=-1)


def not_lambert(scene: Scene) -> np.ndarray:
    return scene.image**0.7 * PAINT


def noisy(scene: Scene) -> np.ndarray:
    return scene.image * PAINT * np.random.default_rng(1).normal(1, 0.1, scene.image.shape)


@pytest.mark.parametrize("image_of", [glossy, many_colours, not_lambert, noisy], ids=lambda image_of: image_of.__name__)
def test_any_other_surface_stays_as_it_is(image_of: Callable[[Scene], np.ndarray], scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    after = refine_normals(scene.capture(image=image_of(scene) * scene.mask[..., None]), network(scene))
    np.testing.assert_array_equal(after.vectors, network(scene).vectors)
    np.testing.assert_array_equal(after.confidence, network(scene).confidence)


def test_three_flat_faces_prove_nothing(scenes: dict[str, Scene]) -> None:
    """A box's three faces of three colours fit one colour as well as another."""
    scene = scenes["distant"]
    y, x = np.mgrid[: len(scene.mask), : len(scene.mask)]
    faces = np.array([[0.5, -0.3, 0.8], [-0.5, -0.3, 0.8], [0.0, 0.6, 0.8]])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    face = np.where(y < 60, 2, np.where(x < 80, 1, 0))
    normals = np.where(scene.mask[..., None], faces[face], 0)
    colours = np.array([[1, 0.6, 0.5], [0.5, 0.9, 0.6], [0.7, 0.7, 1]])[face]
    box = replace(scene, normals=normals, image=np.maximum(normals @ DIRECTIONS.T, 0) * colours)
    np.testing.assert_array_equal(refine_normals(box.capture(), network(box)).vectors, network(box).vectors)


def test_clipped_pixels_stay_as_they_are(scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    image = scene.image * PAINT
    clip = float(np.quantile(image[scene.lit, 0], 0.8))
    capture = scene.capture(image=np.minimum(image, clip), clip=clip)
    clipped = capture.saturated.any(axis=-1) & scene.mask
    after, before = refine_normals(capture, network(scene)), network(scene)
    np.testing.assert_array_equal(after.vectors[clipped], before.vectors[clipped])
    assert errors(after, scene)[scene.lit & ~clipped].mean() < 0.3


def test_tiles_are_the_same_as_the_whole(scenes: dict[str, Scene], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scenes["wide lens"]
    monkeypatch.setattr(refine, "TILE", 1000)
    whole = refine_normals(painted(scene), network(scene))
    monkeypatch.setattr(refine, "TILE", 24)
    tiles = refine_normals(painted(scene), network(scene))
    np.testing.assert_allclose(tiles.vectors, whole.vectors, atol=1e-5)
    np.testing.assert_allclose(tiles.confidence, whole.confidence, atol=1e-5)


def test_the_default_is_exact_on_a_matt_ball(scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    assert errors(estimate_normals(painted(scene), "multiscale"), scene)[scene.lit].mean() < 0.3
