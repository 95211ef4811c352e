"""The photo is checked in Blender, with the rig that lit it, and the findings stay in the panel."""

import bpy
import numpy as np
import pytest

from blender_addon.commands import main
from blender_addon.settings.record import notes_of
from mpsnet_core import read_image, write_image


def test_a_rendered_photo_is_checked_with_its_own_rig(photographed, scene, capfd):
    bpy.ops.mps.check_photo()
    notes = notes_of(scene, "check_photo")
    items = [note.split(":")[0] for note in notes[:7]]
    assert items == ["exposure", "clipping", "channels", "lights", "rig", "reach", "focus"]
    assert {note.level for note in notes[:7]} == {"good"}
    assert "The photo is good" in capfd.readouterr().out
    assert main(["check-photo"]) == 0
    told = capfd.readouterr().out
    assert "exposure: " in told and told.endswith("mpsnet: check-photo done\n")


def test_what_is_wrong_with_a_photo_is_named(photographed, scene, tmp_path, capfd):
    photo = read_image(tmp_path / "photo.exr")
    assert photo.alpha is not None
    bright = photo.pixels / photo.pixels[photo.alpha > 0.5].max() * 1.5
    write_image(tmp_path / "shot.png", bright.clip(0, 1))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "shot.png"))
    bpy.ops.mps.check_photo()
    (said,) = [note for note in notes_of(scene, "check_photo") if note.startswith("clipping: ")]
    assert said.level == "stop" and said.code == "clipped-photo"
    assert "use a shorter exposure" in said
    assert "The photo should be taken again" in capfd.readouterr().out


def test_without_a_rig_nothing_is_said_of_the_lights(scene, tmp_path):
    write_image(tmp_path / "plain.exr", np.full((40, 40, 3), [0.5, 0.4, 0.3]))
    with pytest.raises(RuntimeError, match="Render or open a photo first"):
        bpy.ops.mps.check_photo()
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "plain.exr"))
    scene.mps.estimate.mask = "NONE"
    bpy.ops.mps.check_photo()
    assert not any(note.startswith("lights") for note in notes_of(scene, "check_photo"))
