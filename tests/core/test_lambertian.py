"""Equation 2 on a sphere whose normals are known, and what shadow and saturation leave behind."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import CROSSTALK, Sphere, degrees_between, shaded_sphere, write_file

from mpsnet_core import Capture, read_capture
from mpsnet_core.estimate.estimator import Estimator, estimate_normals
from mpsnet_core.scene.rig import LightRig, direction_from_angles, published_rig

BASELINES = ("lambertian", "lambertian-grey-world")
SKEWED = LightRig(direction_from_angles([25, 40, 35], [80, 200, 310]))
MIXED = LightRig(SKEWED.directions, np.array(CROSSTALK))


def mean_error(sphere: Sphere, capture: Capture | None = None, model: str = "lambertian") -> float:
    normals = estimate_normals(capture or sphere.capture(), model)
    return float(degrees_between(normals.vectors, sphere.normals)[sphere.lit].mean())


@pytest.mark.parametrize("rig", [published_rig(), SKEWED, MIXED], ids=["published", "skewed", "mixed"])
def test_an_analytic_sphere_is_exact_outside_attached_shadow(rig: LightRig) -> None:
    assert mean_error(shaded_sphere(rig=rig)) <= 0.01


def test_grey_world_undoes_the_colour_of_the_surface() -> None:
    brown = shaded_sphere(albedo=(0.9, 0.5, 0.2))
    grey = estimate_normals(shaded_sphere().capture(), "lambertian-grey-world")
    assert mean_error(brown) > 15
    estimate = estimate_normals(brown.capture(), "lambertian-grey-world")
    assert degrees_between(estimate.vectors, grey.vectors)[brown.mask].max() < 0.01
    # The three lights are alike, so on a sphere their channels' means are too.
    assert mean_error(brown, model="lambertian-grey-world") < 0.5


def test_grey_world_leaves_a_black_channel_black(sphere: Sphere) -> None:
    image = sphere.image * [1, 0, 3]
    mean = image[sphere.mask].mean(axis=0)
    divided = np.stack([image[..., 0] / mean[0], image[..., 1], image[..., 2] / mean[2]], axis=-1)
    expected = np.linalg.solve(sphere.rig.directions, divided[..., None])[..., 0]
    estimate = estimate_normals(sphere.capture(image=image), "lambertian-grey-world")
    told = sphere.mask & (image.max(axis=-1) > 0)
    assert degrees_between(estimate.vectors, expected)[told].max() < 0.01


def test_what_equation_2_does_not_use_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    Estimator("lambertian", passes=1)
    assert not caplog.text
    Estimator("lambertian", passes=3, provider="cuda")
    assert "lambertian is not a network and runs without provider cuda and 3 passes" in caplog.text


def spoiled(sphere: Sphere, what: str) -> Capture:
    """The sphere's capture with its left half spoiled."""
    image, clip = sphere.image.copy(), np.inf
    left = image[:, : image.shape[1] // 2]
    if what == "black":
        left[...] = 0
    elif what == "negative":
        left[...] = -0.01
    elif what == "saturated":
        left[...], clip = 1, 1.0
    elif what == "one channel black":
        image[..., 1] = 0
    elif what == "only one pixel":
        image[...] = 0
        image[32, 32] = 1
    return sphere.capture(image=image, clip=clip)


@pytest.mark.parametrize("model", BASELINES)
@pytest.mark.parametrize("what", ["black", "negative", "saturated", "one channel black", "only one pixel"])
@pytest.mark.parametrize("rig", [published_rig(), MIXED], ids=["published", "mixed"])
def test_no_shadow_or_saturation_makes_a_nan(what: str, model: str, rig: LightRig) -> None:
    sphere = shaded_sphere(rig=rig)
    normals = estimate_normals(spoiled(sphere, what), model)
    assert np.linalg.norm(normals.vectors[sphere.mask], axis=-1) == pytest.approx(1, abs=1e-5)
    assert np.isfinite(normals.vectors).all() and np.isfinite(normals.confidence).all()
    # What is spoiled is at most as sure as it was, and somewhere less.
    before, after = estimate_normals(sphere.capture(), model).confidence, normals.confidence
    spoiled_half = sphere.mask & (np.arange(64) < 32)
    assert after[spoiled_half].mean() < before[spoiled_half].mean()


class TestConfidence:
    """The share of usable channels: a third for each light that reaches the pixel unsaturated."""

    def test_attached_shadow_counts_lights(self, sphere: Sphere) -> None:
        shading = np.stack([sphere.normals @ light for light in sphere.rig.directions], axis=-1)
        confidence = estimate_normals(sphere.capture(), "lambertian").confidence
        # Clearly lit or clearly not; between lies the threshold's own business.
        clear = sphere.mask & ((shading > 0.05) | (shading < 0)).all(axis=-1)
        assert {0, 1, 2, 3} >= set(np.unique((shading > 0).sum(axis=-1)[clear])) >= {2, 3}
        assert confidence[clear] == pytest.approx((shading > 0).sum(axis=-1)[clear] / 3)

    def test_saturated_8_bit_values_are_marked(self, tmp_path: Path, sphere: Sphere) -> None:
        exposed = sphere.image * 1.5
        mask = write_file(tmp_path / "mask.png", sphere.mask, "uint8")
        photo = write_file(tmp_path / "photo.png", exposed, "uint8")
        confidence = estimate_normals(
            read_capture(photo, sphere.rig, mask=mask, encoding="linear"), "lambertian"
        ).confidence
        saturated, clear = exposed >= 1, sphere.lit & (sphere.image > 0.05).all(axis=-1)
        clear &= ((exposed >= 1) | (exposed < 0.98)).all(axis=-1)
        assert saturated[clear].any(axis=-1).sum() > 50
        assert confidence[clear] == pytest.approx(1 - saturated[clear].mean(axis=-1))

    def test_under_crosstalk_one_saturated_channel_spoils_all(self) -> None:
        sphere = shaded_sphere(rig=MIXED)
        image = sphere.image.copy()
        image[30:34, 30:34, 1] = 1
        confidence = estimate_normals(sphere.capture(image=image, clip=1.0), "lambertian").confidence
        assert (confidence[30:34, 30:34] == 0).all() and confidence[29, 29] == 1
