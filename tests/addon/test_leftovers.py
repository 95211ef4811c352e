"""What the add-on's commands leave behind: the files that they were asked for, and nothing else.

The core's are in tests/core/test_every_verb.py.
"""

import os
import subprocess
import sys

import bpy
import pytest

from blender_addon.commands import VERBS

pytestmark = pytest.mark.long

# Options with which a verb works in the scene of the test. Others say what they lack, and must leave nothing either.
OPTIONS = {
    "add_rig": "",
    "render_photo": "--output o.exr --width 16 --height 16 --samples 1",
    "render_truth": "--output o.exr",
    "open_photo": "--filepath photo.exr",
    "check_photo": "",
    "show_mask": "",
    "estimate": "--model LAMBERTIAN --output o.png",
    "bake": "--output o.png",
    "integrate": "--output o.exr",
    "render_samples": "--output o --count 1 --size 32 --samples 1 --processes 1",
}
# Where a verb would work without any.
LACKS = {"try_it": "--output nowhere/o", "scan": "--photo nowhere.exr"}


@pytest.fixture
def places(estimated, tmp_path):
    """The environment with empty folders for what programs keep, and a saved scene to work in."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir()
    known = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
    temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(tmp_path / "tmp"))
    return {**known, **temporary, "HOME": str(tmp_path / "home")}


@pytest.mark.parametrize("verb", VERBS)
def test_a_command_leaves_what_it_was_asked_for_alone(places, tmp_path, verb):
    before = {path.name for path in tmp_path.iterdir()}
    words = [verb.replace("_", "-"), *OPTIONS.get(verb, LACKS.get(verb, "")).split()]
    command = [sys.executable, "-m", "blender_addon", "scene.blend", *words]
    done = subprocess.run(command, cwd=tmp_path, env=places, capture_output=True, text=True, timeout=300)
    assert done.returncode == (0 if verb in OPTIONS else 2), done.stderr
    assert not list((tmp_path / "tmp").iterdir())
    assert not [path for path in (tmp_path / "home").rglob("*") if path.is_file()]  # Blender makes empty folders there
    new = {path.name for path in tmp_path.iterdir()} - before
    assert all(name.startswith(("o", "scene_Scene_mask")) for name in new), new  # a mask has no other name
