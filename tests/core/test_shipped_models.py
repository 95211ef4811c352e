"""What the shipped models promise, measured on scenes that no training job shows."""

from dataclasses import replace
from functools import cache
from hashlib import sha256
from typing import Literal

import numpy as np
import pytest

from mpsnet_core import Capture, NormalMap, Sample, angular_error
from mpsnet_core.estimate.estimator import Estimator, estimate_normals
from mpsnet_core.estimate.registry import (
    COMPARISON_FOLDER,
    DEFAULT_MODEL,
    MODELS_FOLDER,
    QUICK_MODEL,
    known_models,
    registered_models,
)
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_SEED, held_out_blob, ideal_photograph, published_view
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Material, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import build_shape

pytestmark = pytest.mark.accuracy

SIZE = 96
MATERIALS = (Material(base_color=(0.7, 0.5, 0.4), roughness=0.6), Material(base_color=(0.3, 0.4, 0.6), roughness=0.4))


@cache
def default() -> Estimator:
    return Estimator(DEFAULT_MODEL)


def scene(seed: int) -> SceneDescription:
    """A blob of two soft-edged colours under three lights."""
    upright = published_view(
        {**held_out_blob(), "seed": seed},
        MATERIALS,
        SIZE,
        pattern=Pattern("noise", scale=2.0, softness=0.5, seed=3),
        bounces=1,
    )
    tilts = [10.0, 130.0, 250.0]
    return replace(upright, light_directions=direction_from_angles(np.full(3, 30.0), tilts))


@cache
def sample(seed: int = HELD_OUT_SEED) -> Sample:
    recipe = scene(seed)
    return synthesise(recipe, build_shape(recipe.shape), [load_reflectance(material) for material in recipe.materials])


@cache
def published(seed: int) -> Capture:
    return ideal_photograph(sample(seed), "published")


@cache
def error_of(seed: int, model: str = DEFAULT_MODEL, passes: Literal[1, 3] | None = None) -> float:
    """Degrees, of a model's normals of the published photo."""
    vectors = estimate_normals(published(seed), model, passes=passes).vectors
    return float(angular_error(vectors, sample(seed).normals)[published(seed).mask].mean())


@cache
def upright() -> tuple[Capture, NormalMap]:
    capture = ideal_photograph(sample(), "separated")
    return capture, default()(capture)


def moved(other: NormalMap) -> float:
    """Mean angle between another answer for the upright capture and its own."""
    capture, ours = upright()
    return float(angular_error(other.vectors, ours.vectors)[capture.mask].mean())


def test_exposure_does_not_matter() -> None:
    capture, _ = upright()
    assert moved(default()(replace(capture, image=capture.image * 10))) < 0.1


@pytest.mark.parametrize("strengths", [(0.5, 2.0, 1.0), (2.0, 0.5, 0.7), (1.5, 1.5, 0.5)])
def test_strengths_of_the_lights_do_not_lead_astray(strengths: tuple[float, float, float]) -> None:
    """A rig is calibrated, so a network may make use of the strengths; it must not rely on them alone."""
    capture, _ = upright()
    assert moved(default()(replace(capture, image=capture.image * np.float32(strengths)))) < 10


def test_three_passes_are_better_than_one_on_the_mean_of_eight_scenes() -> None:
    seeds = range((1 << 62) + 1, (1 << 62) + 9)
    once, thrice = ([error_of(seed, passes=passes) for seed in seeds] for passes in (1, 3))
    assert np.mean(thrice) < np.mean(once)


def test_a_still_is_averaged_and_the_quick_model_is_one_pass_under_its_old_name_too(caplog) -> None:
    capture, ours = upright()
    once, thrice = estimate_normals(capture, passes=1), estimate_normals(capture, passes=3)
    np.testing.assert_array_equal(ours.vectors, thrice.vectors)
    assert moved(once) > 0.1
    for name in (QUICK_MODEL, "multiscale-int8"):
        caplog.clear()
        np.testing.assert_array_equal(estimate_normals(capture, name).vectors, once.vectors)
        assert (QUICK_MODEL in caplog.text) == (name != QUICK_MODEL)


@pytest.mark.parametrize("seed", [(1 << 62) + 1, (1 << 62) + 2])
def test_default_is_better_than_every_other(seed: int) -> None:
    # Not its own variants, and not MPS-Net patch by patch, which takes long.
    others = [
        entry.name
        for entry in registered_models()
        if not entry.name.startswith(DEFAULT_MODEL) and entry.name != "mpsnet"
    ]
    errors, ours = {name: error_of(seed, name) for name in others}, error_of(seed, passes=3)
    assert ours < 0.8 * min(errors.values()), errors


def test_package_stays_small() -> None:
    sizes = {file.stem: file.stat().st_size for file in MODELS_FOLDER.glob("*.onnx")}
    assert set(sizes) == {"lights", "multiscale", "mpsnet"}
    assert sum(sizes.values()) <= 19_000_000, "wheels have 20 MB at most"


def test_the_networks_to_compare_with_are_those_that_the_registry_names() -> None:
    named = {entry.file: entry.sha256 for entry in known_models() if entry.sha256}
    assert named == {file: sha256(file.read_bytes()).hexdigest() for file in COMPARISON_FOLDER.iterdir()}
