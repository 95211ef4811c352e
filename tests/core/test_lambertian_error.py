"""How far equation 2 is off on a material, against what is known of matt ones."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import matt_fits

from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.reflectance.lambertian_error import PUBLISHED_MIXING, lambertian_error, measured_errors
from mpsnet_core.synthesis.scene_description import Material


def matt(*colour: float) -> float:
    material = Material(base_color=(colour[0], colour[1], colour[2]), roughness=1.0, specular=0.0)
    return lambertian_error(load_reflectance(material))


def test_a_matt_grey_is_what_equation_2_takes_it_for() -> None:
    assert matt(0.3, 0.3, 0.3) < 0.01


def test_a_colour_is_taken_for_a_tilt() -> None:
    # Frontal pixels show the mixed colour itself, and of lights 120 degrees apart the brighter one seems nearer.
    assert matt(0.8, 0.2, 0.2) > matt(0.8, 0.5, 0.5) > 3
    red = PUBLISHED_MIXING @ (0.8, 0.2, 0.2)
    sine, cosine = np.sin(np.radians(30)), np.cos(np.radians(30))
    tilts = np.radians([90, 210, 330])
    lights = np.stack([sine * np.cos(tilts), sine * np.sin(tilts), np.full(3, cosine)], axis=1)
    frontal = np.linalg.solve(lights, red * cosine)
    off = np.degrees(np.arccos(frontal[2] / np.linalg.norm(frontal)))
    assert matt(0.8, 0.2, 0.2) == pytest.approx(off, rel=0.35)


def test_each_measured_material_has_its_own(tmp_path: Path) -> None:
    errors = measured_errors(str(matt_fits(tmp_path / "fits.npz", grey=(0.4, 0.4, 0.4), red=(0.6, 0.1, 0.1))))
    assert errors["grey"] < 0.01 and errors["red"] > 15
