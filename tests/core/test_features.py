"""The maps that networks see, against their definitions written out."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import CROSSTALK, degrees_between, shaded_sphere

from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS, feature_maps
from mpsnet_core.scene.rig import LightRig, published_rig

SPHERE = shaded_sphere(48, LightRig(published_rig().directions, np.array(CROSSTALK)), albedo=(0.9, 0.5, 0.3))
UNMIXED = np.linalg.solve(np.array(CROSSTALK), SPHERE.image.astype(float)[..., None])[..., 0]


WHITE = np.random.default_rng(0).uniform(0.2, 0.9, SPHERE.image.shape).astype(np.float32) * np.float32([1, 2, 3])
CLIPPED = WHITE > [0.85, 9, 2.6]


def capture_of(**changes: np.ndarray | None) -> Capture:
    return SPHERE.capture(**{"white": WHITE, "white_clipped": CLIPPED, **changes})


def feature(name: str) -> np.ndarray:
    return feature_maps(capture_of(), [name])[name].transpose(1, 2, 0)


@pytest.mark.parametrize("name", sorted(FEATURE_CHANNELS.keys() - CONSTANTS - {"previous"}))
def test_every_map_has_its_channels_and_is_zero_outside_the_mask(name: str) -> None:
    values = feature_maps(capture_of(), [name])[name]
    assert values.shape == (FEATURE_CHANNELS[name], 48, 48)
    assert values.dtype == np.float32
    assert (values[:, ~SPHERE.mask] == 0).all() and values[:, SPHERE.mask].any()


def test_photo_is_unmixed_and_has_mean_one() -> None:
    expected = UNMIXED[SPHERE.mask] / UNMIXED[SPHERE.mask].mean()
    np.testing.assert_allclose(feature("photo")[SPHERE.mask], expected, atol=1e-5)


def test_grey_world_has_mean_one_in_each_channel() -> None:
    expected = UNMIXED[SPHERE.mask] / UNMIXED[SPHERE.mask].mean(axis=0)
    np.testing.assert_allclose(feature("grey_world")[SPHERE.mask], expected, atol=1e-5)


@pytest.mark.parametrize("image", ["photo", "grey_world"])
def test_initial_normals_solve_equation_2(image: str) -> None:
    name = {"photo": "initial_normals", "grey_world": "initial_normals_grey_world"}[image]
    expected = np.linalg.solve(SPHERE.rig.directions, feature(image).astype(float)[..., None])[..., 0]
    assert degrees_between(feature(name), expected)[SPHERE.mask].max() < 0.01
    assert np.linalg.norm(feature(name)[SPHERE.mask], axis=-1) == pytest.approx(1, abs=1e-5)


def test_mask_is_the_captures() -> None:
    np.testing.assert_array_equal(feature("mask")[..., 0], SPHERE.mask)


def test_lights_are_one_pixel_of_nine_numbers() -> None:
    lights = feature_maps(SPHERE.capture(), ["lights"])["lights"]
    assert (lights.shape, lights.dtype) == ((9, 1, 1), np.float32)
    first, second, third = lights.reshape(3, 3)
    for given, direction in zip((first, second, third), SPHERE.rig.directions, strict=True):
        assert given == pytest.approx(direction, abs=1e-6)


def test_the_white_photo_has_mean_one_in_each_channel_where_none_is_clipped_and_is_zero_where_one_is() -> None:
    told = SPHERE.mask & ~CLIPPED.any(axis=-1)
    assert 0.5 < told.sum() / SPHERE.mask.sum() < 0.95
    np.testing.assert_allclose(feature("white")[told], WHITE[told] / WHITE[told].mean(axis=0), atol=1e-5)
    assert not feature("white")[~told].any()


@pytest.mark.parametrize("changes", [{"white": None, "white_clipped": None}, {"white_clipped": WHITE > 0}])
def test_a_white_photo_that_tells_nothing_is_as_good_as_none(changes: dict) -> None:
    maps = feature_maps(capture_of(**changes), ["white", "given"])
    assert not maps["white"].any() and not maps["given"].any()


def test_a_channel_that_is_black_in_the_white_photo_stays_black() -> None:
    white = feature_maps(capture_of(white=WHITE * np.float32([1, 0, 1])), ["white"])["white"]
    assert np.isfinite(white).all() and not white[1].any() and white[0].any() and white[2].any()


def test_a_whole_photo_has_no_scale_before_it() -> None:
    maps = feature_maps(capture_of(), ["previous", "given"])
    assert maps["previous"].shape == (4, 48, 48) and not maps["previous"].any()
    np.testing.assert_array_equal(maps["given"][:, 0, 0], [0, 1])


@pytest.mark.parametrize("exact", [False, True])
def test_a_rig_that_is_known_exactly_is_marked(exact: bool) -> None:
    capture = replace(SPHERE.capture(), rig=replace(SPHERE.rig, exact=exact))
    np.testing.assert_array_equal(feature_maps(capture, ["exact"])["exact"], np.full((1, 1, 1), float(exact)))


def test_channel_means_are_what_tells_grey_world_from_the_photo() -> None:
    means = feature("channel_means")
    assert means.shape == (1, 1, 3)
    np.testing.assert_allclose(feature("grey_world") * means, feature("photo"), atol=1e-5)
