"""What artists choose goes on: from one file to the next, and as presets of their own."""

import bpy
import pytest

from blender_addon.settings.choices import choices, restore_choices, save_choices


@pytest.fixture
def preferences():
    """The add-on's, with nothing remembered before and after."""
    found = bpy.context.preferences.addons["blender_addon"].preferences
    found.remembered = ""
    yield found
    found.remembered, found.remember = "", True


def new_file():
    """As a live Blender opens a new file."""
    save_choices()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    restore_choices()
    return bpy.context.scene.mps


def test_a_new_file_begins_with_what_was_changed_in_the_last(preferences):
    mps = new_file()
    mps.rig.slant, mps.bake.preset, mps.samples.kinds = 40, "UNREAL", {"BLOBS"}
    mps.bake.convention = "OPENGL"  # which the preset has otherwise
    mps.photo.output = "//mine.exr"
    mps.material.crop_left = 12
    mps = new_file()
    assert (mps.rig.slant, mps.samples.kinds) == (40, {"BLOBS"})
    assert (mps.bake.preset, mps.bake.convention) == ("UNREAL", "OPENGL")
    assert (mps.photo.output, mps.material.crop_left) == ("", 0)
    mps.rig.slant = 30
    assert new_file().rig.slant == 30
    preferences.remember = False
    assert new_file().bake.preset == "CUSTOM"


def test_a_file_that_has_its_own_keeps_them_and_they_are_not_taken_for_the_artists(preferences, tmp_path):
    mps = new_file()
    mps.rig.tilt = 10
    theirs = str(tmp_path / "theirs.blend")
    bpy.ops.wm.save_as_mainfile(filepath=theirs)
    mps = new_file()
    mps.rig.tilt, mps.rig.slant = 20, 50
    save_choices()
    bpy.ops.wm.open_mainfile(filepath=theirs)
    restore_choices()
    mps = bpy.context.scene.mps
    assert (mps.rig.tilt, mps.rig.slant) == (10, 30)
    mps = new_file()
    assert (mps.rig.tilt, mps.rig.slant) == (20, 50)


@pytest.mark.parametrize(
    "text", ["[", "3", '{"rig.slant": "steep", "rig.gone": 1, "gone.slant": 2, "rig.tilt": 1e999}']
)
def test_what_another_version_kept_does_no_harm(preferences, text):
    before = choices(bpy.context.scene)
    preferences.remembered = text
    mps = new_file()
    assert {**choices(bpy.context.scene), "rig.tilt": 90} == before
    assert mps.rig.tilt in (90, 360)


@pytest.fixture
def user_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("BLENDER_USER_SCRIPTS", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("step", "chosen"),
    [
        ("rig", {"light_type": "AREA", "slant": 41.5}),
        ("bake", {"preset": "UNREAL", "convention": "OPENGL", "size": 512, "level": True}),
    ],
)
def test_a_preset_that_is_written_is_read_back(scene, user_folder, step, chosen):
    group = getattr(scene.mps, step)
    for name, value in chosen.items():
        setattr(group, name, value)
    if step == "bake":
        group.output = "//mine.png"
    kept = choices(scene)
    add = getattr(bpy.ops.mps, f"add_{step}_preset")
    add(name="My Own")
    (file,) = user_folder.glob("presets/mpsnet/*/*.py")
    assert file.parent.name == step and "mine.png" not in file.read_text()
    for name in chosen:
        group.property_unset(name)
    assert choices(scene) != kept
    bpy.ops.script.execute_preset(filepath=str(file), menu_idname=f"MPS_PT_{step}_presets")
    assert choices(scene) == kept
    add(name="My Own", remove_name=True)
    assert not file.exists()
