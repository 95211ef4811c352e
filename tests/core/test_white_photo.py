"""A white photo paints the object grey: against the photo of one that is grey."""

from dataclasses import replace

import numpy as np
import pytest
from near_scene import NEAR, ball
from painted_sphere import GAINS, MIXED, Painted
from synthetic import CROSSTALK, degrees_between

from mpsnet_core import Capture, estimate_normals
from mpsnet_core.estimate.white_photo import normalise_by_white_photo
from mpsnet_core.scene.rig import LightRig, direction_from_angles, published_rig


@pytest.mark.parametrize("narrow", [False, True])
def test_of_a_matt_object_it_is_the_photo_of_a_grey_one(narrow: bool) -> None:
    """Whatever paint, crosstalk and gains are: each light alone, on the mean of the three albedos."""
    painted = Painted(narrow=narrow)
    found = normalise_by_white_photo(painted.capture)
    np.testing.assert_allclose(found.image, painted.albedo.mean(axis=-1, keepdims=True) * painted.light, atol=0.004)
    assert painted.off(painted.capture, painted.lit).max() < 0.5
    assert painted.off(replace(painted.capture, white=None), painted.lit).mean() > 10


@pytest.mark.parametrize("other", ["pose", "lamp", "none"])
def test_a_white_photo_of_something_else_is_reported(caplog: pytest.LogCaptureFixture, other: str) -> None:
    painted = Painted()
    lit = np.maximum(painted.sphere.normals @ direction_from_angles(25, 70), 0)[..., None]
    white = {
        "pose": np.rot90(painted.capture.white).copy(),
        "lamp": painted.albedo * lit,
        "none": painted.capture.white,
    }
    normalise_by_white_photo(replace(painted.capture, white=white[other]))
    assert ("does not fit the photo" in caplog.text) == (other != "none")


def test_a_white_photo_of_a_grey_object_that_was_moved_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    """Few pixels tell, those at its outline: a sphere's shading hardly changes where it moves by little."""
    painted = Painted()
    grey = painted.light.sum(axis=-1, keepdims=True) * np.ones(3)
    for pixels in (0, 4):
        capture = replace(painted.capture, image=painted.light @ MIXED.mixing.T, white=np.roll(grey, pixels, axis=1))
        normalise_by_white_photo(capture)
        assert ("does not fit the photo" in caplog.text) == (pixels > 0)


def test_another_lamp_may_have_lit_the_white_photo() -> None:
    painted, lamp = Painted(), direction_from_angles(25, 70)
    cosine = np.maximum(painted.sphere.normals @ lamp, 0)
    white = painted.albedo * cosine[..., None] * GAINS
    lit = painted.lit & (cosine > 0.1)
    known, taken_for_the_rig = (
        painted.off(replace(painted.capture, white=white, white_light=light), lit).mean() for light in (lamp, None)
    )
    assert known < 0.5 and taken_for_the_rig > 5


@pytest.mark.parametrize(("value", "pixels"), [(100.0, 12), (2500.0, 4)])
def test_a_few_pixels_of_glare_change_nothing_elsewhere(value: float, pixels: int) -> None:
    painted = Painted()
    image, white = np.array(painted.capture.image), np.array(painted.capture.white)
    rows, columns = (places[:pixels] for places in np.nonzero(painted.lit))
    image[rows, columns] += value
    white[rows, columns] += value
    others = painted.lit.copy()
    others[rows, columns] = False
    assert painted.off(replace(painted.capture, image=image, white=white), others).mean() < 0.5


def test_where_a_light_does_not_reach_the_lamp_is_no_sum_of_lights() -> None:
    """Low lights, which reach a part of the sphere each."""
    lamp = direction_from_angles(40, 20)
    painted = Painted(LightRig(direction_from_angles([50, 55, 45], [80, 205, 330]), np.array(CROSSTALK)))
    cosine = np.maximum(painted.sphere.normals @ lamp, 0)
    white = painted.albedo * cosine[..., None] * GAINS
    found = painted.off(replace(painted.capture, white=white, white_light=lamp), painted.lit & (cosine > 0.1))
    assert found.mean() < 0.5


def test_under_near_lights_every_pixel_has_its_own_lamp() -> None:
    """The three lights stand 1.5 times the ball's size away, and the one lamp is far."""
    scene, lamp = ball(near=NEAR, size=80), direction_from_angles(20, 0)
    columns = np.arange(80) // 13 % 3
    albedo = np.array([[0.7, 0.06, 0.05], [0.05, 0.4, 0.1], [0.8, 0.6, 0.05]])[columns]
    white = (albedo * np.maximum(scene.normals @ lamp, 0)[..., None] * GAINS).astype(np.float32)
    capture = scene.capture(image=(albedo * scene.image).astype(np.float32), white=white, white_light=lamp)
    where = scene.lit & (scene.normals @ lamp > 0.1)
    off = degrees_between(estimate_normals(capture, "lambertian").vectors, scene.normals)[where]
    assert np.median(off) < 1


def test_an_order_of_unmixing_without_shares_is_left_out() -> None:
    """A channel whose lights cancel out has no share of grey light; of narrow lights the other order does it."""
    rig = LightRig(published_rig().directions, np.array([[1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    painted = Painted(rig, narrow=True)
    assert painted.off(painted.capture, painted.lit).mean() < 0.5


def test_a_flat_surface_gets_as_much_of_every_light() -> None:
    """One direction determines no plane: what is left is near grey world, and no gains beyond all bounds."""
    image = np.full((20, 20, 3), 0.4) * [1, 2, 0.5] + np.random.default_rng(2).normal(0, 0.004, (20, 20, 3))
    capture = Capture(image, np.ones((20, 20), bool), published_rig(), white=np.full((20, 20, 3), 0.5))
    found = normalise_by_white_photo(capture).image.mean(axis=(0, 1))
    np.testing.assert_allclose(found / found.mean(), 1, atol=0.25)


@pytest.mark.parametrize("black", [0, 1, 2])
def test_a_white_photo_without_one_colour_says_nothing(black: int) -> None:
    painted = Painted()
    white = np.array(painted.capture.white)
    white[..., black] = 0
    found = normalise_by_white_photo(replace(painted.capture, white=white))
    assert found.white is None
    np.testing.assert_array_equal(found.image, painted.capture.image)


def test_where_it_is_clipped_the_surface_is_taken_to_have_its_mean_colour(caplog: pytest.LogCaptureFixture) -> None:
    """On a surface of one colour that is the truth; where the white photo is clipped all over it says nothing."""
    painted = Painted(colours=1)
    clipped = np.zeros(painted.capture.image.shape, bool)
    clipped[30:60, 30:60, 1] = True
    found = normalise_by_white_photo(replace(painted.capture, white_clipped=clipped))
    np.testing.assert_allclose(found.image, normalise_by_white_photo(painted.capture).image, rtol=0.05, atol=0.01)
    clipped[painted.sphere.mask] = True
    assert normalise_by_white_photo(replace(painted.capture, white_clipped=clipped)).white is None
    clipped[40, 40:55] = False  # too few to measure by
    nearly_all = replace(painted.capture, white_clipped=clipped)
    assert normalise_by_white_photo(nearly_all).white is None
    estimate_normals(nearly_all, "lambertian")
    assert "the white photo is NOT USED" in caplog.text


def test_a_pixel_saturated_in_one_channel_is_known_to_be_wrong_in_all() -> None:
    painted = Painted()
    clipped = np.zeros(painted.capture.image.shape, bool)
    clipped[50, 50, 2] = True
    found = normalise_by_white_photo(replace(painted.capture, clipped=clipped))
    assert found.saturated[50, 50].all() and found.saturated.sum() == 3


def test_what_is_dark_in_the_white_photo_is_not_divided_by_its_noise() -> None:
    painted = Painted()
    white = np.array(painted.capture.white)
    white[40:44, 40:44] = 1e-9
    found = normalise_by_white_photo(replace(painted.capture, white=white)).image
    assert np.isfinite(found).all() and np.abs(found[40:44, 40:44]).max() < 2 * painted.capture.image.max()
