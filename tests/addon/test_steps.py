"""How each step of the panel stands: what is missing, what went wrong, what is out of date, how long it will take."""

import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.photo import MPS_PT_photo
from blender_addon.panels.rig import MPS_PT_rig
from blender_addon.panels.step import Kind
from blender_addon.panels.text import lines, shortened
from blender_addon.provenance import seen_lately
from blender_addon.time_left import Pace, in_words


def stands(step):
    state = step.state(bpy.context)
    return state.kind, state.why


def kinds():
    return [step.state(bpy.context).kind for step in (MPS_PT_rig, MPS_PT_photo, MPS_PT_estimate, MPS_PT_bake)]


def test_the_steps_become_ready_and_done_from_top_to_bottom(sphere, scene, tmp_path):
    TO_DO, READY, DONE = Kind.TO_DO, Kind.READY, Kind.DONE
    assert kinds() == [READY, TO_DO, TO_DO, TO_DO]
    bpy.ops.mps.add_rig()
    assert kinds() == [DONE, READY, TO_DO, TO_DO]
    bpy.ops.mps.render_photo(width=32, height=32, samples=1, output=str(tmp_path / "photo.exr"))
    assert kinds() == [DONE, DONE, READY, TO_DO]
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    assert kinds() == [DONE, DONE, DONE, READY]
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"))
    assert kinds() == [DONE, DONE, DONE, DONE]


def test_what_is_missing_is_said_where_it_is_and_on_the_button(scene):
    assert stands(MPS_PT_rig) == (Kind.TO_DO, "Select the object, then add the rig. A photo that you took needs none")
    assert stands(MPS_PT_estimate) == (Kind.TO_DO, "Render or open a photo first")
    with pytest.raises(RuntimeError, match="Render or open a photo first"):
        bpy.ops.mps.estimate()


def test_a_rig_that_lost_a_light_needs_mending(photographed, scene):
    bpy.data.objects.remove(scene.mps.rig.lights[0].object)
    kind, why = stands(MPS_PT_rig)
    assert kind is Kind.FAILED and "red light was deleted" in why


@pytest.fixture
def baked(estimated, scene, tmp_path):
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"))
    return scene


def move_a_light(scene, tmp_path):
    scene.mps.rig.lights[0].object.location.x += 1
    bpy.context.view_layer.update()


def move_the_camera(scene, tmp_path):
    scene.mps.rig.camera.location.x += 1
    bpy.context.view_layer.update()


def make_the_photo_larger(scene, tmp_path):
    scene.mps.photo.width = 64


def choose_another_model(scene, tmp_path):
    scene.mps.estimate.model = "LAMBERTIAN_GREY_WORLD"


def take_the_photo_again(scene, tmp_path):
    bpy.ops.mps.render_photo()


def export_the_photo_again(scene, tmp_path):
    bpy.data.scenes.new("Other")  # nothing of Blender's is touched but a file
    path = tmp_path / "photo.exr"
    path.write_bytes(path.read_bytes() + b"\0")


def estimate_again(scene, tmp_path):
    bpy.ops.mps.estimate()


def move_the_target(scene, tmp_path):
    scene.mps.bake.target.location.x += 1
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    ("change", "step", "named"),
    [
        (move_a_light, MPS_PT_photo, "Lights"),
        (move_the_camera, MPS_PT_photo, "Camera"),
        (make_the_photo_larger, MPS_PT_photo, "Width"),
        (choose_another_model, MPS_PT_estimate, "Model"),
        (take_the_photo_again, MPS_PT_estimate, "Photo"),
        (export_the_photo_again, MPS_PT_estimate, "Photo"),
        (estimate_again, MPS_PT_bake, "Normals"),
        (move_the_target, MPS_PT_bake, "Target's place"),
    ],
)
def test_what_has_changed_since_makes_one_step_out_of_date(baked, estimated, tmp_path, change, step, named):
    if change is move_the_target:
        bpy.ops.mps.bake(target=estimated.name)
    steps = [MPS_PT_photo, MPS_PT_estimate, MPS_PT_bake]
    assert [stands(one)[0] for one in steps] == [Kind.DONE] * 3
    change(baked, tmp_path)
    assert stands(step) == (Kind.OUT_OF_DATE, f"Changed since: {named}")
    assert [one for one in steps if stands(one)[0] is Kind.OUT_OF_DATE] == [step]


def test_files_are_looked_at_once_a_second_however_often_the_panel_is_drawn(baked, tmp_path, monkeypatch):
    looked, clock = [], [time.monotonic() + 10]
    stat = Path.stat

    def counted(path, **how):
        looked.append(path.name)
        return stat(path, **how)

    monkeypatch.setattr(Path, "stat", counted)
    monkeypatch.setattr("blender_addon.provenance.time", SimpleNamespace(monotonic=lambda: clock[0]))

    def drawn():
        with seen_lately():
            return [stands(one)[0] for one in (MPS_PT_photo, MPS_PT_estimate, MPS_PT_bake)]

    for _ in range(3):
        clock[0] += 0.3
        assert drawn() == [Kind.DONE] * 3
    assert sorted(looked) == ["normals.png", "photo.exr"]
    export_the_photo_again(baked, tmp_path)
    looked.clear()
    clock[0] += 0.5
    assert drawn() == [Kind.DONE, Kind.OUT_OF_DATE, Kind.DONE]
    assert looked.count("photo.exr") == 1
    bpy.ops.mps.estimate()  # what is made is made of the files as they are
    assert drawn() == [Kind.DONE, Kind.DONE, Kind.OUT_OF_DATE]


def test_what_was_made_stays_done_when_things_are_renamed_and_the_file_is_opened_again(baked, estimated, tmp_path):
    for datablocks in (bpy.data.objects, bpy.data.images, bpy.data.materials, bpy.data.meshes, bpy.data.scenes):
        for datablock in datablocks:
            datablock.name = f"renamed {datablock.name}"
    for _ in range(2):
        assert kinds() == [Kind.DONE] * 4
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))


def test_a_photo_from_outside_is_not_compared_with_the_rig(photographed, scene, tmp_path):
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    move_a_light(scene, tmp_path)
    assert stands(MPS_PT_photo) == (Kind.DONE, "")


def test_an_error_stays_until_the_next_run(photographed, scene, tmp_path):
    with pytest.raises(RuntimeError, match="does not exist"):
        bpy.ops.mps.estimate(model="FILE", model_file=str(tmp_path / "nothing.onnx"))
    kind, why = stands(MPS_PT_estimate)
    assert kind is Kind.FAILED and "nothing.onnx" in why
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert stands(MPS_PT_estimate) == (kind, why)
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    assert stands(MPS_PT_estimate) == (Kind.DONE, "")


def test_an_error_that_is_dismissed_is_gone(photographed):
    with pytest.raises(RuntimeError):
        bpy.ops.mps.estimate(model="FILE", model_file="nowhere.onnx")
    bpy.ops.mps.dismiss(verb="estimate")
    assert stands(MPS_PT_estimate) == (Kind.READY, "")
    bpy.ops.mps.dismiss(verb="estimate")  # nothing is left to take away


def test_notes_stay_with_the_step(estimated, scene):
    assert "read as linear (float file)" in scene.mps.records["estimate"].notes


def test_made_from_what_no_add_on_wrote_is_not_out_of_date(estimated, scene):
    for text in ("[]", "{", '{"Model": 3}'):
        scene.mps.estimate.image["mpsnet_made_from"] = text
        assert stands(MPS_PT_estimate)[0] in {Kind.DONE, Kind.OUT_OF_DATE}
    scene.mps.estimate.image["mpsnet_made_by"] = "cancel"
    assert stands(MPS_PT_estimate) == (Kind.DONE, "")


def test_time_left_is_told_once_it_can_be_known():
    assert [Pace().left(0.0, done) for done in (0.0, 0.5)] == [None, None]
    pace = Pace()
    assert pace.left(5.0, 0.01) is None  # what went before, the start of a process, tells nothing of the work
    assert pace.left(7.0, 0.02) is None  # too little to tell
    assert pace.left(9.0, 0.21) == pytest.approx(4.0 * 0.79 / 0.20)
    # Where nothing moves on, it takes longer than was thought.
    assert pace.left(19.0, 0.21) == pytest.approx(14.0 * 0.79 / 0.20)
    # A second part that begins anew is measured anew.
    assert pace.left(20.0, 0.1) is None
    # Long work tells it after less of it.
    assert pace.left(39.0, 0.11) is None
    assert pace.left(41.0, 0.11) == pytest.approx(21.0 * 0.89 / 0.01)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (None, ""),
        (0.2, "5 s left"),
        (41.0, "40 s left"),
        (58.0, "1 min left"),
        (95.0, "2 min left"),
        (3590.0, "1 h left"),
        (7900.0, "2 h 10 min left"),
    ],
)
def test_time_left_in_words(seconds, words):
    assert in_words(seconds) == words


def test_text_is_broken_and_shortened_to_a_width():
    sentence = "cannot read /home/somebody/pictures/a_long_name.exr: it is not an image"
    broken = lines(sentence, 20, len)
    assert max(map(len, broken)) <= 20
    assert "".join("".join(broken).split()) == "".join(sentence.split())
    assert lines("short", 20, len) == ["short"]
    assert lines("", 20, len) == []
    short = shortened("14:32  a_long_name.exr", 12, len)
    assert len(short) == 12 and short.startswith("14:32") and short.endswith(".exr")
    assert shortened("fits", 12, len) == "fits"
