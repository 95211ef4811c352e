"""Grain of a matt surface of one chromaticity is divided out of its photo; whatever proves none stays as it is."""

from collections.abc import Callable

import numpy as np
import pytest
from near_scene import NEAR, WIDE, Scene, ball
from synthetic import degrees_between

from mpsnet_core import Capture, estimate_normals, published_rig
from mpsnet_core.arrays.resampling import gaussian
from mpsnet_core.estimate.albedo_removal.grain import divide_out_grain

pytestmark = pytest.mark.accuracy

PAINT = np.array([0.9, 0.5, 0.3])


@pytest.fixture(scope="module")
def scenes() -> dict[str, Scene]:
    return {"distant": ball(None), "wide lens": ball(WIDE), "near lights": ball(50, NEAR)}


def grain(shape: tuple[int, ...], amount: float = 0.08, seed: int = 1) -> np.ndarray:
    """(H, W, 1) factors with this standard deviation of their logarithm."""
    spots = gaussian(np.random.default_rng(seed).normal(size=shape[:2]), 1.2, range(2))
    return np.exp(amount * spots / spots.std())[..., None]


def spread(scene: Scene, capture: Capture, paint: np.ndarray = PAINT) -> float:
    """Standard deviation of a photo's brightness against that of the scene without grain, where all lights reach."""
    ratio = capture.image[scene.lit] / (scene.image * paint)[scene.lit]
    return float(np.log(ratio.mean(axis=-1)).std())


@pytest.mark.parametrize("name", ["distant", "wide lens", "near lights"])
def test_grain_is_divided_out(name: str, scenes: dict[str, Scene]) -> None:
    scene = scenes[name]
    capture = scene.capture(image=scene.image * PAINT * grain(scene.image.shape))
    assert spread(scene, capture) > 0.07
    assert spread(scene, divide_out_grain(capture)) < 0.015


@pytest.mark.parametrize("steep", [0.0, 0.1])
def test_of_a_nearly_flat_wall_too(steep: float) -> None:
    """It is taken to face the camera, as its lengths hardly tell its colour."""
    x, y = np.meshgrid(np.linspace(0, 60, 128), np.linspace(0, 60, 128))
    normals = np.stack([steep * np.sin(x), steep * np.cos(y), np.ones_like(x)], axis=-1)
    rig = published_rig()
    clean = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)) @ rig.directions.T * PAINT
    clean *= 1 + 0.003 * np.random.default_rng(4).normal(size=clean.shape)
    found = divide_out_grain(Capture((clean * grain(clean.shape)).astype(np.float32), np.ones((128, 128), bool), rig))
    assert np.log(found.image / clean).mean(axis=-1).std() < 0.015


def test_noise_of_the_sensor_stays_in_part(scenes: dict[str, Scene]) -> None:
    """So that the solver of matt surfaces sees how exact equation 2 is."""
    scene = scenes["distant"]
    noise = 1 + 0.01 * np.random.default_rng(2).normal(size=scene.image.shape)
    found = divide_out_grain(scene.capture(image=scene.image * grain(scene.image.shape) * noise))
    assert 0.004 < spread(scene, found, np.ones(3)) < 0.02


def two_colours(scene: Scene) -> np.ndarray:
    cells = (np.add.outer(*(np.arange(side) // 16 for side in scene.mask.shape)) % 2).astype(bool)
    return np.where(cells[..., None], [0.9, 0.5, 0.3], [0.5, 0.7, 0.4])


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda scene: np.ones(3), id="no grain"),
        pytest.param(lambda scene: two_colours(scene) * grain(scene.image.shape), id="two colours"),
        pytest.param(lambda scene: scene.image**0.5 * grain(scene.image.shape), id="not matt"),
        pytest.param(
            lambda scene: np.concatenate([grain(scene.image.shape, seed=seed) for seed in range(3)], axis=-1),
            id="tinted grain",
        ),
        pytest.param(lambda scene: grain(scene.image.shape, 0.5), id="a pattern"),
        pytest.param(
            lambda scene: 1 + 0.04 * np.random.default_rng(5).normal(size=scene.image.shape), id="noise of the sensor"
        ),
    ],
)
def test_what_proves_no_grain_stays(change: Callable[[Scene], np.ndarray], scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    capture = scene.capture(image=scene.image * change(scene))
    assert divide_out_grain(capture) is capture


def test_shadows_and_clipped_pixels_stay(scenes: dict[str, Scene]) -> None:
    scene = scenes["distant"]
    image = (scene.image * grain(scene.image.shape)).astype(np.float32)
    side = len(image)
    image[side // 2 : side // 2 + 8, side // 3 : side // 3 + 8] *= 0.2
    bright = scene.mask & (image.max(axis=-1) > np.percentile(image[scene.mask], 99))
    clip = float(image[bright].max(axis=-1).min())
    capture = scene.capture(image=np.minimum(image, clip), clip=clip)
    found = divide_out_grain(capture)
    assert found is not capture
    shadow = found.image[side // 2 + 1 : side // 2 + 7, side // 3 + 1 : side // 3 + 7]
    np.testing.assert_array_equal(shadow, capture.image[side // 2 + 1 : side // 2 + 7, side // 3 + 1 : side // 3 + 7])
    np.testing.assert_array_equal(found.saturated, capture.saturated)
    np.testing.assert_array_equal(found.image[capture.saturated], capture.image[capture.saturated])


def test_a_grainy_relief_that_fills_the_photo_is_estimated() -> None:
    """To the network alone the grain is relief: its normals are off by more than ten degrees."""
    x, y = np.meshgrid(np.linspace(-1, 1, 192), np.linspace(1, -1, 192))
    hill = 0.35 * np.exp(-(x**2 + y**2) / 0.5)
    along_x = -4 * x * hill + 0.3 * np.cos(2.5 * x) * np.cos(2 * y)
    along_y = -4 * y * hill - 0.24 * np.sin(2.5 * x) * np.sin(2 * y)
    normals = np.stack([-along_x, -along_y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    rig = published_rig()
    image = np.maximum(normals @ rig.directions.T, 0) * grain((192, 192)) * PAINT
    image *= 1 + 0.005 * np.random.default_rng(3).normal(size=image.shape)
    found = estimate_normals(Capture(image.astype(np.float32), np.ones((192, 192), bool), rig), passes=1)
    assert degrees_between(found.vectors, normals).mean() < 2.0
