"""Recipes: the same wherever they are drawn, within their ranges, whole through JSON."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import matt_fits

from mpsnet_core.errors import InputError
from mpsnet_core.scene.rig import angles_of
from mpsnet_core.synthesis import scene_sampling
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.scene_description import scene_from_data
from mpsnet_core.synthesis.scene_sampling import draw_scene

JOB = SampleJob(renderer="synthesis", count=400, seed=5, size=64)
RECIPES = [draw_scene(JOB, number) for number in range(400)]


def test_a_recipe_depends_on_seed_and_number_alone():
    for number in (399, 0, 17):
        assert draw_scene(JOB, number).data() == RECIPES[number].data()
    longer = SampleJob(renderer="synthesis", count=9000, seed=5, size=64)
    assert draw_scene(longer, 3).data() == RECIPES[3].data()
    other = SampleJob(renderer="synthesis", count=400, seed=6, size=64)
    assert draw_scene(other, 3).data() != RECIPES[3].data()


def test_recipes_survive_json():
    for recipe in RECIPES[:50]:
        again = scene_from_data(json.loads(json.dumps(recipe.data())))
        assert again.data() == recipe.data()
        assert again.materials == recipe.materials


def test_what_is_no_recipe_is_said():
    data = RECIPES[0].data()
    for broken in ({**data, "materials": [{"kind": "principled", "colour": 3}]}, {**data, "rotation": [1, 2]}, {}):
        with pytest.raises(InputError, match="recipe is not known to this program"):
            scene_from_data(broken)
    with pytest.raises(InputError, match="version 99"):
        scene_from_data({**data, "version": 99})


def test_numbers_that_show_one_shape_differ_in_all_else():
    job = SampleJob(renderer="synthesis", count=12, seed=1, views=4)
    recipes = [draw_scene(job, number) for number in range(8)]
    assert all(recipe.shape == recipes[0].shape for recipe in recipes[:4])
    assert recipes[4].shape != recipes[0].shape
    assert len({recipe.rotation.tobytes() for recipe in recipes}) == 8


def test_turns_are_rotations_and_upright_things_stand_upright():
    for recipe in RECIPES:
        turn = recipe.rotation
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
        up = turn @ [0, 0, 1]
        if recipe.shape["pose"] == "upright":  # at most 55° down upon it and 8° aslant
            assert up[1] > np.cos(np.radians(55)) * np.cos(np.radians(8)) - 1e-9
        elif recipe.shape["pose"] == "front":
            assert up[2] >= np.cos(np.radians(40)) - 1e-9


def test_free_turns_have_no_preferred_direction():
    rng = np.random.default_rng(0)
    seen = np.array([scene_sampling._rotation(rng, "any")[2] for _ in range(4000)])
    # Of uniformly distributed unit vectors every coordinate has mean 0 and variance 1/3 (sigma of the mean 0.009).
    assert np.abs(seen.mean(axis=0)).max() < 0.04
    assert np.abs((seen**2).mean(axis=0) - 1 / 3).max() < 0.03


def test_lights_are_within_their_slants_and_surround_the_camera():
    for recipe in RECIPES:
        directions = recipe.light_directions
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
        slants = np.degrees(np.arccos(directions[:, 2]))
        assert slants.min() >= 20 - 1e-9 and slants.max() <= 60 + 1e-9
        assert np.linalg.svd(directions, compute_uv=False)[-1] > 0.1
        assert recipe.light_sizes.min() >= 0 and recipe.light_sizes.max() <= 20


def test_lights_of_any_rig_are_often_on_one_side_and_determine_a_normal():
    job = SampleJob(renderer="synthesis", count=300, seed=5, size=64, rigs="any")
    directions = np.array([draw_scene(job, number).light_directions for number in range(300)])
    slants, tilts = angles_of(directions)
    assert slants.min() < 10 and slants.max() > 60 and slants.max() < 70
    assert np.linalg.svd(directions, compute_uv=False)[:, -1].min() > 0.02
    gaps = np.diff(np.sort(tilts), axis=1)
    widest = np.maximum(gaps.max(axis=1), 360 - gaps.sum(axis=1))
    # Three tilts drawn at random lie within half a turn three times in four.
    assert 0.5 < (widest > 180).mean() < 0.85


@pytest.mark.parametrize("most", [0, 1, 2, 3])
def test_light_bounces_up_to_as_often_as_the_job_asks(most: int):
    job = SampleJob(renderer="synthesis", count=400, seed=5, size=64, bounces=most)
    found = np.bincount([draw_scene(job, number).bounces for number in range(400)], minlength=4) / 400
    shares = [0.2, 0.55, 0.15, 0.1]
    expected = [*shares[:most], sum(shares[most:]), *[0.0] * (3 - most)]
    np.testing.assert_allclose(found, expected, atol=0.07)
    assert not found[most + 1 :].any()


def test_the_paper_s_samples_are_of_measured_materials_under_its_rigs(tmp_path: Path):
    job = SampleJob(
        renderer="synthesis",
        count=300,
        seed=8,
        size=64,
        merl=str(matt_fits(tmp_path / "fits.npz", a=(0.4, 0.4, 0.4), b=(0.6, 0.1, 0.1))),
        style="paper",
    )
    recipes = [draw_scene(job, number) for number in range(300)]
    for recipe in recipes:
        # Not of the strong red, whose equation 2 is off by much.
        assert len(recipe.materials) >= 2 and {material.source for material in recipe.materials} == {"a"}
        assert recipe.pattern.kind != "parts"
        assert not (recipe.paint.amount or recipe.dirt.amount or recipe.bump.height or recipe.light_sizes.any())
    coloured = [draw_scene(replace(job, style="paper-all-materials"), number) for number in range(20)]
    assert {material.source for recipe in coloured for material in recipe.materials} == {"a", "b"}
    slants, tilts = angles_of(np.array([recipe.light_directions for recipe in recipes]))
    rigs = np.array(scene_sampling.PUBLISHED_RIGS)
    off_slant = np.abs(slants[:, None] - rigs[:, 0]).max(axis=-1)
    off_tilt = np.abs((tilts[:, None] - rigs[:, 1] + 180) % 360 - 180).max(axis=-1)
    nearest = np.argmin(off_slant + off_tilt, axis=1)
    assert np.maximum(off_slant, off_tilt)[np.arange(300), nearest].max() <= 4 + 1e-9
    assert np.bincount(nearest, minlength=5).min() > 40  # of 60 each

    one_rig = [draw_scene(replace(job, style="paper-one-rig"), number) for number in range(20)]
    assert {material.source for recipe in one_rig for material in recipe.materials} == {"a", "b"}
    slants, tilts = angles_of(np.array([recipe.light_directions for recipe in one_rig]))
    assert np.abs(slants - 30).max() <= 4 + 1e-9
    assert np.abs(tilts - (90, 210, 330)).max() <= 4 + 1e-9
