"""Samples in the canonical light frame: turned, mirrored and reordered, they remain what they are."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sphere_sample import sphere_sample
from synthetic import degrees_between, shaded_sphere

from mpsnet_core.rig import direction_from_angles
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.photographs.capture_model import CaptureModel
from mpsnet_core.synthesis.photographs.dataset import CANONICAL_REACH, SampleDataset
from mpsnet_core.synthesis.sample import write_sample

SIZE = 32
# 120° apart in all, in both senses, or not.
EVEN = [[90.0, 210.0, 330.0], [73.0, 193.0, 313.0], [200.0, 80.0, 320.0], [0.0, 240.0, 120.0]]
UNEVEN = [[80.0, 215.0, 330.0], [10.0, 60.0, 200.0], [10.0, 200.0, 60.0]]


def spheres(folder: Path, tilts: Sequence[Sequence[float]]) -> Path:
    """A white matt sphere for each three tilts, shaded here by n · l."""
    for number, three in enumerate(tilts):
        directions = direction_from_angles([25.0, 35.0, 45.0], three)
        sample = sphere_sample(SIZE, number=number)
        shading = np.maximum(np.einsum("hwi,ki->khw", shaded_sphere(SIZE).normals, directions), 0)
        lights = np.repeat(shading[..., None], 3, axis=3).astype(np.float32)
        recipe = replace(sample.recipe, light_directions=directions)
        write_sample(sample_path(folder, number), replace(sample, lights=lights, recipe=recipe))
    return folder


def first_s_tilt(directions: np.ndarray) -> float:
    """Degrees from straight up."""
    return abs(np.degrees(np.arctan2(directions[0, 0], directions[0, 1])))


@pytest.mark.parametrize("augment", [False, True])
def test_lights_run_counter_clockwise_from_one_that_is_nearly_up(augment: bool, tmp_path: Path) -> None:
    dataset = SampleDataset(
        spheres(tmp_path, EVEN + UNEVEN), capture_model=CaptureModel.ideal(), canonical=True, augment=augment
    )
    arrangements: dict[int, set[bytes]] = {}
    for index in range(len(dataset)):
        for epoch in range(12):
            directions = dataset.capture(index, epoch)[0].rig.directions
            tilts = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
            assert np.linalg.det(directions) > 0
            if index < len(EVEN):
                assert first_s_tilt(directions) <= CANONICAL_REACH + 1e-6
                np.testing.assert_allclose((tilts - tilts[0]) % 360, [0, 120, 240], atol=1e-6)
            arrangements.setdefault(index, set()).add(directions.round(6).tobytes())
    # By chance, where that is asked for: each of three lights up, turned or mirrored.
    assert all(len(found) > 1 if augment else len(found) == 1 for found in arrangements.values())


def test_without_augmentation_the_nearest_arrangement_is_taken(tmp_path: Path) -> None:
    dataset = SampleDataset(
        spheres(tmp_path, EVEN + UNEVEN), capture_model=CaptureModel.ideal(), canonical=True, augment=False
    )
    for index, tilts in enumerate(EVEN + UNEVEN):
        # A quarter turn more or less, mirrored or not, whichever light is first.
        offs = [(sign * (tilt - 90) + 45) % 90 - 45 for tilt in tilts for sign in (1, -1)]
        directions = dataset.capture(index)[0].rig.directions
        assert first_s_tilt(directions) == pytest.approx(min(map(abs, offs)), abs=1e-4)


def test_what_is_seen_is_still_a_sphere_in_its_light(tmp_path: Path) -> None:
    """A sphere's normals point to where the pixel is, however it was turned; equation 2 finds them from the photo."""
    dataset = SampleDataset(spheres(tmp_path, EVEN + UNEVEN), capture_model=CaptureModel.ideal(), canonical=True)
    sphere = shaded_sphere(SIZE)
    for index in range(len(dataset)):
        for epoch in range(6):
            capture, truth = dataset.capture(index, epoch)
            np.testing.assert_allclose(truth, sphere.normals, atol=1e-6)
            np.testing.assert_array_equal(capture.mask, sphere.mask)
            shading = sphere.normals @ capture.rig.directions.T
            lit = sphere.mask & (shading > 0.02).all(axis=-1)
            found = np.linalg.solve(capture.rig.directions, capture.image[lit][..., None].astype(float))[..., 0]
            assert degrees_between(found, truth[lit]).max() < 0.1  # light is stored as half floats
