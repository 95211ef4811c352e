"""Scripts in a .blend file run in our Blenders where the person says so, and nowhere else: hostile files, opened."""

import os
import re
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

from blender_addon.child_process import trust
from blender_addon.child_process.core_process import CoreProcess
from blender_addon.photo.background_render import rendering_blender, written_job
from blender_addon.settings.record import notes_of
from mpsnet_core.errors import Note


def touching(name):
    """Python that leaves a file in the folder of the file it is in, as the value 2."""
    return f"__import__('pathlib').Path({name!r}).touch() or 2"


def drive(obj, expression):
    driver = obj.driver_add("scale", 2).driver
    driver.type, driver.expression = "SCRIPTED", expression


@pytest.fixture
def hostile(sphere, scene, tmp_path):
    """A saved file with a driver on what the viewport hides, one in a linked library, and nothing else of Python.

    All that runs leaves a file in the folder "ran".
    """
    ran = tmp_path / "ran"
    ran.mkdir()
    mesh = sphere.data.copy()
    linked = bpy.data.objects.new("Linked", mesh)
    drive(linked, touching(str(ran / "linked driver")))
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {linked}, fake_user=True)
    bpy.data.objects.remove(linked)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True, relative=True) as (_, here):
        here.objects = ["Linked"]
    hidden = bpy.data.objects.new("Hidden", sphere.data)
    drive(hidden, touching(str(ran / "hidden driver")))
    for obj in (hidden, here.objects[0]):
        scene.collection.objects.link(obj)
    hidden.hide_viewport = True
    parts = bpy.data.collections.new("Parts")
    scene.collection.children.link(parts)
    scene.collection.objects.unlink(here.objects[0])
    parts.objects.link(here.objects[0])
    parts.hide_viewport = True
    bpy.ops.mps.add_rig()
    scene.mps.photo.width, scene.mps.photo.height, scene.mps.photo.samples = 24, 16, 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hostile.blend"))
    return ran


def opened(tmp_path):
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hostile.blend"), use_scripts=False)


def notes_of_render(tmp_path, name="job"):
    """The notes that the button's other Blender answers."""
    folder = tmp_path / name
    folder.mkdir()
    output = tmp_path / f"{name}.exr"
    process = CoreProcess(written_job(bpy.context, "normals", output, folder), [output], rendering_blender(folder))
    return [Note.from_facts(facts) for facts in process.result()["told"]]


@pytest.fixture
def preferences():
    """The person's own, as they were afterwards."""
    preferences = bpy.context.preferences
    before = preferences.filepaths.use_scripts_auto_execute
    yield preferences
    preferences.filepaths.use_scripts_auto_execute = before
    while preferences.autoexec_paths:
        preferences.autoexec_paths.remove(preferences.autoexec_paths[0])


def test_drivers_that_the_window_never_evaluates_do_not_run_in_the_render_and_that_is_reported(hostile, tmp_path):
    opened(tmp_path)
    assert not bpy.app.autoexec_fail  # nothing here looks as if scripts were off
    (note,) = notes_of_render(tmp_path)
    assert note.startswith("scripts are off where this was rendered") and "tick Run Scripts Once" in note
    assert not list(hostile.iterdir())


def test_drivers_that_the_window_shows_and_registered_texts_with_handlers_do_not_run_either(hostile, tmp_path):
    text = bpy.data.texts.new("hostile.py")
    text.use_module = True
    text.write(
        "import bpy, pathlib\n"
        f"mark = lambda *_: pathlib.Path({str(hostile / 'handler')!r}).touch()\n"
        "bpy.app.handlers.load_post.append(mark)\nbpy.app.handlers.render_init.append(mark)\n"
        f"pathlib.Path({str(hostile / 'text')!r}).touch()\n"
    )
    bpy.data.objects["Hidden"].hide_viewport = False
    bpy.ops.wm.save_mainfile()
    opened(tmp_path)
    assert trust.SCRIPTS_OFF in notes_of_render(tmp_path)[0]
    assert not list(hostile.iterdir())


def test_the_box_lets_scripts_run_in_one_render_and_no_file_can_tick_or_keep_it(hostile, tmp_path):
    opened(tmp_path)
    box = bpy.context.window_manager.mps
    box.run_scripts = True
    assert not {"run_scripts"} & {*box.keys(), *bpy.context.scene.mps.keys()}
    bpy.ops.wm.save_mainfile()
    opened(tmp_path)
    assert not bpy.context.window_manager.mps.run_scripts
    bpy.context.window_manager.mps.run_scripts = True
    assert notes_of_render(tmp_path, "ticked") == []
    assert {path.name for path in hostile.iterdir()} == {"hidden driver", "linked driver"}
    for path in hostile.iterdir():
        path.unlink()
    assert len(notes_of_render(tmp_path, "next")) == 1
    assert not list(hostile.iterdir())


def test_the_preferences_let_them_run_but_for_files_and_libraries_under_excluded_paths(hostile, tmp_path, preferences):
    opened(tmp_path)
    preferences.filepaths.use_scripts_auto_execute = True
    assert trust.open_file_is_trusted()
    excluded = preferences.autoexec_paths.new()
    for path, use_glob, trusted in [
        (f"{tmp_path}/", False, False),
        (str(tmp_path)[:-1], False, False),
        ("", False, True),
        ("*", True, False),
        (f"*{tmp_path.name}*", True, False),
        (f"{tmp_path}/elsewhere/", False, True),
    ]:
        excluded.path, excluded.use_glob = path, use_glob
        assert trust.open_file_is_trusted() is trusted, path
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "library.blend").rename(elsewhere / "library.blend")
    bpy.data.libraries[0].filepath = "//elsewhere/library.blend"
    assert not trust.open_file_is_trusted()


@pytest.mark.skipif(sys.platform == "win32", reason="links need permission")
def test_a_link_to_an_excluded_folder_leads_nowhere_else(tmp_path, preferences):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    preferences.filepaths.use_scripts_auto_execute = True
    preferences.autoexec_paths.new().path = f"{tmp_path / 'real'}/"
    assert not trust.preferences_trust(str(tmp_path / "link" / "file.blend"))


def test_scripts_that_the_command_line_forbids_do_not_run_though_the_preferences_trust(preferences, monkeypatch):
    preferences.filepaths.use_scripts_auto_execute = True
    assert trust.preferences_trust("/anywhere/file.blend")
    monkeypatch.setattr(sys, "argv", ["blender", "-Y"])
    assert not trust.preferences_trust("/anywhere/file.blend")


def test_the_plain_module_opens_a_file_without_its_scripts(hostile, tmp_path):
    bpy.data.objects["Hidden"].hide_viewport = False
    bpy.ops.wm.save_mainfile()
    command = [sys.executable, "-m", "blender_addon", tmp_path / "hostile.blend", "render-truth"]
    done = subprocess.run([*command, "--output", tmp_path / "truth.exr"], env=os.environ, timeout=120)
    assert done.returncode == 0 and Path(tmp_path / "truth.exr").is_file()
    assert not list(hostile.iterdir())


def test_samples_of_a_scenes_own_objects_are_rendered_without_its_scripts_and_that_is_reported(hostile, tmp_path):
    opened(tmp_path)
    bpy.data.objects["Hidden"].hide_viewport = False
    bpy.ops.object.select_all(action="DESELECT")
    bpy.data.objects["Hidden"].select_set(True)
    small = {"source": "SCENE", "size": 32, "samples": 4, "denoise": False, "count": 1, "processes": 1}
    bpy.ops.mps.render_samples(output=str(tmp_path / "samples"), **small)
    assert (tmp_path / "samples" / "sample_000000.exr").is_file()
    (note,) = notes_of(bpy.context.scene, "render_samples")
    assert re.fullmatch(r'scripts are off .*: drivers with Python, as "(Hidden|Linked)" has, keep the values .*', note)
    assert not list(hostile.iterdir())
