"""Make Height: which camera the heights are of."""

import json

import bpy
import numpy as np
import pytest

from mpsnet_core.images import write_image


@pytest.fixture
def own_photo(photographed, scene, tmp_path):
    """A photo of one's own, nothing beside it, in a scene whose rig has an orthographic camera."""
    write_image(tmp_path / "own.png", np.full((48, 64, 3), 0.5, np.float32), bits=8)
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "own.png"))


def height(tmp_path):
    """What the heights' file tells of their camera."""
    bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), mesh=False)
    return json.loads((tmp_path / "h.json").read_text())["camera"]


def test_heights_are_seen_through_the_lens_that_the_normals_were_estimated_with(own_photo, scene, tmp_path):
    bpy.ops.mps.estimate(lens=50, output=str(tmp_path / "n.png"))
    for told_later in (50, 0, 85):
        scene.mps.estimate.lens = told_later
        camera = height(tmp_path)
        assert camera["projection"] == "perspective"
        assert camera["focal"][0] == pytest.approx(64 * 50 / 36)


def test_a_lens_that_is_told_later_is_not_that_of_normals_estimated_without(own_photo, scene, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "n.png"))
    scene.mps.estimate.lens = 50
    assert height(tmp_path)["projection"] == "orthographic"
