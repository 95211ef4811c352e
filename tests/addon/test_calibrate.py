"""Calibrating real lights in the panel: from photos of balls to a rig that the estimate uses."""

import json
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest
from mirror_ball import Scene, around, grey_photograph, lamps_around, photograph
from synthetic import degrees_between

from blender_addon.panels.lights import lacks_of_mixing
from mpsnet_core import LightRig, read_rig, write_image, write_rig

ANGLES = [(35, 80), (50, 200), (42, 320)]
LIGHTS = np.array([around(*angle) for angle in ANGLES])
MIXING = np.array([[1.0, 0.2, 0.1], [0.25, 0.9, 0.15], [0.05, 0.3, 0.8]])
BALLS = Scene([((0.0, 0.0, 0.0), 110.0)], lamps_around((0, 0, 0), 2e4, angles=ANGLES), (300, 300))


@pytest.fixture(scope="module")
def balls(tmp_path_factory):
    folder = tmp_path_factory.mktemp("balls")
    write_image(folder / "mirror.exr", photograph(BALLS, MIXING))
    write_image(folder / "grey.exr", grey_photograph(BALLS, MIXING, LIGHTS))
    return folder


@pytest.fixture
def mirror(balls, tmp_path):
    return str(shutil.copy(balls / "mirror.exr", tmp_path))


@pytest.fixture
def grey(balls, tmp_path):
    return str(shutil.copy(balls / "grey.exr", tmp_path))


def test_lights_and_mixing_are_found_and_used_from_then_on(scene, tmp_path, mirror, grey):
    bpy.ops.mps.calibrate_lights(ball=mirror, lens=800, output=str(tmp_path / "rig.json"))
    assert scene.mps.estimate.lens == 800  # the same camera takes the photo
    calibrate = scene.mps.calibrate
    rows = [line.split("|") for line in calibrate.summary.splitlines()]
    assert [row[0] for row in rows] == ["", "Red", "Green", "Blue"]
    assert {len(row) for row in rows} == {4}
    assert calibrate.image is not None and min(calibrate.image.size) > 100
    assert Path(scene.mps.estimate.rig_file) == tmp_path / "rig.json"
    found = read_rig(tmp_path / "rig.json")
    assert degrees_between(found.directions, LIGHTS).max() < 1

    bpy.ops.mps.calibrate_mixing(grey=grey, output=str(tmp_path / "rig.json"))
    mixed = read_rig(tmp_path / "rig.json")
    np.testing.assert_allclose(mixed.directions, found.directions, atol=1e-6)
    np.testing.assert_allclose(mixed.mixing, MIXING, atol=0.03)
    rows = [line.split("|") for line in calibrate.summary.splitlines()]
    assert [row[0] for row in rows] == ["Channel", "R", "G", "B", "Unexplained"]
    assert [len(row) for row in rows] == [4, 4, 4, 4, 2], "in a column of four their words were cut off"


def test_a_rig_that_goes_with_blender_is_there_again_in_the_saved_file(scene, tmp_path, mirror):
    bpy.ops.mps.calibrate_lights(ball=mirror)
    rig, saved = Path(scene.mps.estimate.rig_file), str(tmp_path / "saved.blend")
    found = rig.read_bytes()
    bpy.ops.wm.save_as_mainfile(filepath=saved)
    rig.unlink()  # as when Blender quits
    bpy.ops.wm.open_mainfile(filepath=saved)
    estimate = bpy.context.scene.mps.estimate
    restored = Path(estimate.rig_file)
    assert restored.read_bytes() == found

    restored.unlink()
    estimate.rig_file = "//chosen.json"  # a file that is missing is not replaced by another rig
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=saved)
    assert bpy.context.scene.mps.estimate.rig_file == "//chosen.json" and not restored.exists()
    bpy.ops.mps.calibrate_lights(ball=mirror)
    assert Path(bpy.context.scene.mps.estimate.rig_file).parent == tmp_path


def test_a_kept_rig_is_not_replaced_by_that_of_another_file(scene, tmp_path, mirror):
    """Of the same name, in the same Blender."""
    bpy.ops.mps.calibrate_lights(ball=mirror)
    rig = Path(scene.mps.estimate.rig_file)
    first, second = str(tmp_path / "first.blend"), str(tmp_path / "second.blend")
    found = rig.read_text(encoding="utf-8")
    bpy.ops.wm.save_as_mainfile(filepath=first)
    other = found + " "
    scene.mps.estimate.rig_file = "/gone/rig.json"
    scene.mps.estimate.kept_rig = json.dumps(["/gone/rig.json", other])
    bpy.ops.wm.save_as_mainfile(filepath=second)
    rig.write_text(other, encoding="utf-8")  # as by a calibration in a new file
    for saved, text in ((first, found), (second, other), (first, found)):
        bpy.ops.wm.open_mainfile(filepath=saved)
        assert Path(bpy.context.scene.mps.estimate.rig_file).read_text(encoding="utf-8") == text


@pytest.mark.parametrize("kept", ['["/gone/rig.json", 5]', '["/gone/rig.json"]', "{", r'["/gone/rig.json", "\ud800"]'])
def test_a_hostile_kept_rig_is_none(scene, tmp_path, kept):
    scene.mps.estimate.rig_file, scene.mps.estimate.kept_rig = "/gone/rig.json", kept
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert bpy.context.scene.mps.estimate.rig_file == "/gone/rig.json"


def test_the_mixing_waits_for_the_lights_and_a_grey_ball(scene):
    assert "Find the lights" in lacks_of_mixing(scene)
    scene.mps.estimate.rig_file = "//rig.json"
    assert "grey ball" in lacks_of_mixing(scene)
    scene.mps.calibrate.grey = "//grey.exr"
    assert not lacks_of_mixing(scene)


def test_a_circle_drawn_by_hand_is_taken(scene, tmp_path, mirror):
    bpy.ops.mps.calibrate_lights(
        ball=mirror, circle_x=150, circle_y=150, circle_radius=110, output=str(tmp_path / "rig.json")
    )
    found = read_rig(tmp_path / "rig.json")
    assert degrees_between(found.directions, LIGHTS).max() < 1


def test_what_is_missing_is_reported(scene, tmp_path, mirror, grey):
    with pytest.raises(RuntimeError, match="choose a photo of a mirror ball"):
        bpy.ops.mps.calibrate_lights()
    with pytest.raises(RuntimeError, match=r"where are the lights.* in the step Rig"):
        bpy.ops.mps.calibrate_mixing(grey=grey)
    write_rig(tmp_path / "rig.json", LightRig(LIGHTS))
    scene.mps.estimate.rig_file = str(tmp_path / "rig.json")
    with pytest.raises(RuntimeError, match="no photo of the grey ball is named"):
        bpy.ops.mps.calibrate_mixing(grey="")
    with pytest.raises(RuntimeError, match=r"name ends in \.json"):
        bpy.ops.mps.calibrate_lights(ball=mirror, output=str(tmp_path / "rig.txt"))
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.mps.calibrate_lights(ball=str(tmp_path / "nowhere.exr"), output=str(tmp_path / "r.json"))
    assert not (tmp_path / "r.json").exists()
