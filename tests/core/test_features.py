"""The maps that networks see, against their definitions written out."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import CROSSTALK, degrees_between, shaded_sphere

from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS, feature_maps
from mpsnet_core.scene.rig import LightRig, published_rig

SPHERE = shaded_sphere(48, LightRig(published_rig().directions, np.array(CROSSTALK)), albedo=(0.9, 0.5, 0.3))
UNMIXED = np.linalg.solve(np.array(CROSSTALK), SPHERE.image.astype(float)[..., None])[..., 0]


def feature(name: str) -> np.ndarray:
    return feature_maps(SPHERE.capture(), [name])[name].transpose(1, 2, 0)


@pytest.mark.parametrize("name", sorted(FEATURE_CHANNELS.keys() - CONSTANTS - {"previous"}))
def test_every_map_has_its_channels_and_is_zero_outside_the_mask(name: str) -> None:
    values = feature_maps(SPHERE.capture(), [name])[name]
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


def test_lights_are_one_pixel_of_nine_numbers() -> None:
    lights = feature_maps(SPHERE.capture(), ["lights"])["lights"]
    assert (lights.shape, lights.dtype) == ((9, 1, 1), np.float32)
    first, second, third = lights.reshape(3, 3)
    for given, direction in zip((first, second, third), SPHERE.rig.directions, strict=True):
        assert given == pytest.approx(direction, abs=1e-6)


def test_a_whole_photo_has_no_scale_before_it() -> None:
    maps = feature_maps(SPHERE.capture(), ["previous", "given"])
    assert maps["previous"].shape == (4, 48, 48) and not maps["previous"].any() and not maps["given"].any()


@pytest.mark.parametrize("exact", [False, True])
def test_a_rig_that_is_known_exactly_is_marked(exact: bool) -> None:
    capture = replace(SPHERE.capture(), rig=replace(SPHERE.rig, is_ground_truth=exact))
    np.testing.assert_array_equal(feature_maps(capture, ["exact"])["exact"], np.full((1, 1, 1), float(exact)))


def test_channel_means_are_what_separates_grey_world_from_the_photo() -> None:
    means = feature("channel_means")
    assert means.shape == (1, 1, 3)
    np.testing.assert_allclose(feature("grey_world") * means, feature("photo"), atol=1e-5)
