"""A second estimate of a painted surface: against the photo of the same surface in one paint."""

from dataclasses import replace

import numpy as np
import pytest
from near_scene import NEAR, ball
from painted_sphere import Painted
from synthetic import degrees_between

from mpsnet_core import Capture, NormalMap, published_rig
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.estimate import dense
from mpsnet_core.estimate.albedo_removal.chromaticity import divide_out_chromaticity_albedo
from mpsnet_core.estimate.albedo_removal.clusters import divide_out_clustered_albedo
from mpsnet_core.estimate.albedo_removal.second_estimate import blend_by_confidence
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.estimate.registry import find_network
from mpsnet_core.estimate.white_photo import normalise_by_white_photo


def bent(painted: Painted, degrees: float) -> NormalMap:
    """The true normals, wrong by up to so much, in waves across the picture."""
    normals = painted.sphere.normals
    height, width = normals.shape[:2]
    x, y = np.meshgrid(np.linspace(0, 14, width), np.linspace(0, 11, height))
    waves = np.stack([np.sin(x), np.cos(y), np.zeros_like(x)], axis=-1)
    return NormalMap(normalised(normals + np.radians(degrees) * waves).astype(np.float32), painted.sphere.mask)


def unevenness(painted: Painted, capture: Capture) -> float:
    """Standard deviation of the logarithm of what the photo is a multiple of, against the light where it arrives."""
    where = painted.lit & (painted.light > 0.2).all(axis=-1)
    multiple = np.log(capture.rig.unmixed(capture.image)[where] / painted.light[where])
    return float(multiple.std(axis=0).max())


def test_the_photo_becomes_that_of_one_paint() -> None:
    painted = Painted(narrow=True)
    photo = replace(painted.capture, white=None)
    found = divide_out_clustered_albedo(photo, bent(painted, 5))
    assert found is not None
    assert unevenness(painted, photo) > 0.8
    assert unevenness(painted, found) < 0.03


@pytest.mark.parametrize("floor", [0.02, 0.005, 1e-4])
def test_pure_paints_are_found_though_most_pixels_are_dark_in_each_light(floor: float) -> None:
    painted = Painted(narrow=True)
    paints = np.full((3, 3), floor) + np.eye(3) * 0.8
    rows, columns = np.indices(painted.sphere.mask.shape)
    albedo = paints[(rows // 11 + columns // 17) % 3]
    photo = Capture(albedo * painted.light, painted.sphere.mask, published_rig())
    found = divide_out_clustered_albedo(photo, bent(painted, 2))
    if found is not None:  # a surface as good as black in two lights has nothing in common
        assert np.isfinite(found.image).all()
        assert unevenness(painted, found) < 0.05


def test_a_highlight_in_half_floats_stays_finite() -> None:
    painted = Painted(narrow=True)
    image = (painted.capture.image * 1000).astype(np.float16)
    image[40:42, 40:42] = 60000
    found = divide_out_clustered_albedo(replace(painted.capture, image=image, white=None), bent(painted, 2))
    assert found is not None and np.isfinite(found.image).all()


def test_near_lights_light_each_place_in_their_own_way() -> None:
    scene = ball(near=NEAR, size=96)
    stripes = np.where(np.indices(scene.mask.shape)[1] // 9 % 2 == 0, 0.2, 0.8)[..., None]
    photo = scene.capture(image=scene.image * stripes)
    found = divide_out_clustered_albedo(photo, NormalMap(scene.normals, scene.mask))
    assert found is not None
    lit = scene.lit & (scene.image > 0.2).all(axis=-1)
    assert np.log(found.image[lit] / scene.image[lit]).std(axis=0).max() < 0.05


def test_a_surface_of_one_paint_needs_no_second_look() -> None:
    painted = Painted(colours=1, narrow=True)
    assert divide_out_clustered_albedo(replace(painted.capture, white=None), bent(painted, 2)) is None


def test_with_a_white_photo_only_the_brightness_of_each_paint_is_left_to_even_out() -> None:
    painted = Painted()
    grey = normalise_by_white_photo(painted.capture)
    found = divide_out_chromaticity_albedo(painted.capture, grey, bent(painted, 2))
    assert unevenness(painted, grey) > 0.3
    # Between two paints a pixel counts as of both.
    assert unevenness(painted, found) < 0.1


def test_black_around_the_object_does_not_count() -> None:
    painted = Painted()
    photo = replace(painted.capture, mask=np.ones_like(painted.sphere.mask))
    normals = bent(painted, 2)
    everywhere = NormalMap(normals.vectors + np.float32([0, 0, 1e-6]), photo.mask)
    found = divide_out_chromaticity_albedo(photo, normalise_by_white_photo(photo), everywhere)
    expected = divide_out_chromaticity_albedo(painted.capture, normalise_by_white_photo(painted.capture), normals)
    np.testing.assert_allclose(found.image[painted.lit], expected.image[painted.lit], rtol=0.2, atol=0.01)


@pytest.mark.parametrize(("white", "size", "share"), [(False, 96, 0.85), (True, 96, 0.85), (False, 520, 0.4)])
def test_a_still_of_a_painted_surface_gains_by_it(
    monkeypatch: pytest.MonkeyPatch, white: bool, size: int, share: float
) -> None:
    """Of 520 pixels a side, most are near edges: 0.61 if the finest scale is estimated once, and sees the paints."""
    monkeypatch.setattr(dense, "FINE", 300**2)
    painted = Painted(size=size, narrow=not white)
    capture = painted.capture if white else replace(painted.capture, white=None)
    network = find_network("multiscale")
    once = OnnxModel(network.path, passes=3)(normalise_by_white_photo(capture))
    twice = Estimator(network.path, passes=3)(capture)

    def error(estimate: NormalMap) -> float:
        return float(degrees_between(estimate.vectors, painted.sphere.normals)[painted.sphere.mask].mean())

    assert error(twice) < share * error(once)


def test_each_pixel_takes_the_estimate_that_expects_less_error() -> None:
    mask = np.array([[True, True, True, False]])
    left, right = (np.broadcast_to(np.float32([x, 0, 1]), (1, 4, 3)) for x in (-1, 1))
    first = NormalMap(left, mask, np.float32([[0.9, 0.5, 0.9, 0.0]]))
    second = NormalMap(right, mask, np.float32([[0.5, 0.9, 0.9, 0.0]]))
    result = blend_by_confidence(first, second)
    np.testing.assert_allclose(result.vectors[0, 0], left[0, 0] / np.sqrt(2), atol=1e-3)
    np.testing.assert_allclose(result.vectors[0, 1], right[0, 0] / np.sqrt(2), atol=1e-3)
    np.testing.assert_allclose(result.confidence, [[0.9, 0.9, 0.9, 0.0]], atol=0.01)
    assert not result.vectors[0, 3].any(), "outside the mask"
    assert -0.5 < result.vectors[0, 2, 0] < 0, "alike: both count, the first one a little more"
