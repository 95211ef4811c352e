"""How each step of the panel stands: what is missing, what went wrong, what is out of date, how long it will take."""

import bpy
import numpy as np
import pytest

from blender_addon.operators.progress import Pace
from blender_addon.panels import CLASSES
from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.material import MPS_PT_material
from blender_addon.panels.photo import MPS_PT_photo
from blender_addon.panels.photo_inputs import lights_of
from blender_addon.panels.rig import MPS_PT_rig
from blender_addon.panels.step import Kind
from mpsnet_core.scene.rig import near_rig, write_rig


def stands(step):
    state = step.state(bpy.context)
    return state.kind, state.why


def kinds():
    return [step.state(bpy.context).kind for step in (MPS_PT_rig, MPS_PT_photo, MPS_PT_estimate, MPS_PT_bake)]


def test_the_steps_become_ready_and_done_from_top_to_bottom(sphere, scene, tmp_path):
    TO_DO, READY, DONE = Kind.TO_DO, Kind.READY, Kind.DONE
    scene.mps.way = "RENDER"
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
    assert stands(MPS_PT_material)[1].startswith("Render or open")
    scene.mps.way = "RENDER"
    assert stands(MPS_PT_rig) == (Kind.TO_DO, "Select the object, then add the rig")
    assert stands(MPS_PT_estimate) == (Kind.TO_DO, "Render or open a photo first")
    with pytest.raises(RuntimeError, match="Render or open a photo first"):
        bpy.ops.mps.estimate()


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


def setting(step, **values):
    """Gives a step's settings these values."""

    def spoil(scene, tmp_path):
        for name, value in values.items():
            setattr(getattr(scene.mps, step), name, value)

    return spoil


def export_the_photo_again(scene, tmp_path):
    bpy.data.scenes.new("Other")  # nothing of Blender's is touched but a file
    path = tmp_path / "photo.exr"
    path.write_bytes(path.read_bytes() + b"\0")


def reshape_the_target(scene, tmp_path):
    bpy.context.object.data.vertices[0].co.x += 1


@pytest.mark.parametrize(
    ("change", "step", "named"),
    [
        (move_a_light, MPS_PT_photo, "Lights"),
        (move_the_camera, MPS_PT_photo, "Camera"),
        (setting("photo", width=64), MPS_PT_photo, "Width"),
        (setting("estimate", model="LAMBERTIAN_GREY_WORLD"), MPS_PT_estimate, "Model"),
        (lambda *_: bpy.ops.mps.render_photo(), MPS_PT_estimate, "Photo"),
        (export_the_photo_again, MPS_PT_estimate, "Photo"),
        (lambda *_: bpy.ops.mps.estimate(), MPS_PT_bake, "Normals"),
        (reshape_the_target, MPS_PT_bake, "Mesh"),
    ],
)
def test_what_has_changed_since_makes_one_step_out_of_date(baked, tmp_path, change, step, named):
    steps = [MPS_PT_photo, MPS_PT_estimate, MPS_PT_bake]
    assert [stands(one)[0] for one in steps] == [Kind.DONE] * 3
    change(baked, tmp_path)
    assert stands(step) == (Kind.OUT_OF_DATE, f"Changed since: {named}")
    assert [one for one in steps if stands(one)[0] is Kind.OUT_OF_DATE] == [step]


def test_a_texture_whose_later_bake_was_undone_is_out_of_date(baked, tmp_path):
    """Undo takes back the material and the settings; the file stays what the later bake wrote, its green inverted."""
    bpy.ops.ed.undo_push(message="baked")
    texture = str(tmp_path / "texture.png")
    bpy.ops.mps.bake(convention="DIRECTX", output=texture)
    bpy.ops.ed.undo_push(message="baked again")
    assert stands(MPS_PT_bake) == (Kind.DONE, "")
    bpy.ops.ed.undo()
    assert bpy.context.scene.mps.bake.convention == "OPENGL"
    assert stands(MPS_PT_bake) == (Kind.OUT_OF_DATE, "Changed since: File")
    bpy.ops.ed.redo()
    assert stands(MPS_PT_bake) == (Kind.DONE, "")
    bpy.ops.ed.undo()
    bpy.ops.mps.bake(output=texture)
    assert stands(MPS_PT_bake) == (Kind.DONE, "")


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


def shown():
    """The panels that the way to the photo shows, and whose parents it shows."""
    polled = {cls.__name__ for cls in CLASSES if hasattr(cls, "poll") and cls.poll(bpy.context)}
    return {cls.__name__ for cls in CLASSES if {cls.__name__, getattr(cls, "bl_parent_id", cls.__name__)} <= polled}


def test_the_way_to_the_photo_shows_its_own_settings_and_follows_what_is_there(sphere, scene, tmp_path):
    assert scene.mps.way == "PHOTOGRAPH"
    photographs = shown()
    bpy.ops.mps.add_rig()  # as in a file of an earlier version, where nobody chose
    assert scene.mps.way == "RENDER"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    mps = bpy.context.scene.mps
    assert mps.way == "RENDER"
    assert photographs - shown() == {
        "MPS_PT_lights",
        "MPS_PT_calibrate",
        "MPS_PT_outline",
        "MPS_PT_mask",
        "MPS_PT_real",
        "MPS_PT_colour",
        "MPS_PT_superpose",
    }
    assert shown() - photographs == {"MPS_PT_rig", "MPS_PT_rig_placement", "MPS_PT_render", "MPS_PT_truth"}
    bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
    mps.way = "RENDER"
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    assert mps.way == "PHOTOGRAPH" and "MPS_PT_align" in shown()
    mps.way = "RENDER"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.context.scene.mps.way == "RENDER"


def test_it_is_doubted_that_the_virtual_rig_lit_a_real_photo(photographed, scene, tmp_path):
    assert lights_of(scene).doubt == ""
    rig = scene.mps.photo.image["mpsnet_rig"]
    bpy.ops.mps.open_photo(filepath=copied(tmp_path, "photo.exr", "taken.exr"))
    assert "virtual rig" in lights_of(scene).doubt
    (tmp_path / "measured.json").write_text(rig, encoding="utf-8")
    scene.mps.estimate.rig_file = str(tmp_path / "measured.json")
    assert lights_of(scene).doubt == ""
    scene.mps.estimate.rig_file = ""
    (tmp_path / "taken.rig.json").write_text(rig, encoding="utf-8")
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "taken.exr"))  # whose own rig lies beside it
    assert lights_of(scene).doubt == ""
    scene.mps.photo.image = None
    assert "virtual rig" in lights_of(scene).doubt
    bpy.ops.mps.remove_rig()
    assert lights_of(scene).doubt == ""


def removing(name):
    return lambda scene, tmp_path: (tmp_path / name).unlink()


def no_lights(scene, tmp_path):
    bpy.ops.mps.open_photo(filepath=copied(tmp_path, "photo.exr", "alone.exr"))
    bpy.ops.mps.remove_rig()


def copied(folder, name, new):
    (folder / new).write_bytes((folder / name).read_bytes())
    return str(folder / new)


def the_rig_file_is_gone(scene, tmp_path):
    no_lights(scene, tmp_path)
    scene.mps.estimate.rig_file = str(tmp_path / "gone.json")


def the_lights_are_near_and_no_camera_is_known(scene, tmp_path):
    no_lights(scene, tmp_path)
    places = np.eye(3) * 2
    write_rig(tmp_path / "near.json", near_rig(places - [0, 0, 3], [0, 0, -5]))
    scene.mps.estimate.rig_file = str(tmp_path / "near.json")


def no_camera_saw_the_normals(scene, tmp_path):
    scene.mps.estimate.image = bpy.data.images.load(copied(tmp_path, "normals.png", "others.png"))
    bpy.ops.mps.remove_rig()


def no_uv_map(scene, tmp_path):
    mesh = bpy.context.object.data
    mesh.uv_layers.remove(mesh.uv_layers[0])


def the_photo_has_no_file(scene, tmp_path):
    scene.mps.photo.image = bpy.data.images.new("Drawn", 8, 8)


def the_target_was_deleted(scene, tmp_path):
    scene.mps.bake.target = bpy.context.object
    bpy.ops.object.delete()


def no_shader_takes_a_normal(scene, tmp_path):
    nodes = bpy.context.object.active_material.node_tree.nodes
    for node in list(nodes):
        nodes.remove(node)


def nothing_is_selected_to_bake_onto(scene, tmp_path):
    scene.mps.bake.objects = "SELECTED"
    bpy.context.object.select_set(False)


def a_light_is_hidden(scene, tmp_path):
    scene.mps.photo.image = None
    scene.mps.rig.lights[0].object.hide_render = True


def a_panoramic_camera(scene, tmp_path):
    scene.mps.photo.image = None
    scene.mps.rig.camera.data.type = "PANO"


def only_a_camera_is_selected(scene, tmp_path):
    camera = scene.mps.rig.camera
    scene.collection.objects.link(camera.copy())
    bpy.ops.mps.remove_rig()
    bpy.ops.object.select_all(action="DESELECT")
    next(obj for obj in scene.objects if obj.type == "CAMERA").select_set(True)
    scene.mps.way = "RENDER"


def the_photo_measures_nobody_knows_what(scene, tmp_path):
    bpy.ops.mps.open_photo(filepath=copied(tmp_path, "photo.exr", "alone.exr"))


@pytest.mark.parametrize(
    ("step", "spoil"),
    [
        (MPS_PT_rig, only_a_camera_is_selected),
        (MPS_PT_photo, a_light_is_hidden),
        (MPS_PT_photo, a_panoramic_camera),
        (MPS_PT_material, no_lights),
        (MPS_PT_estimate, the_rig_file_is_gone),
        (MPS_PT_estimate, the_lights_are_near_and_no_camera_is_known),
        (MPS_PT_estimate, removing("photo.exr")),
        (MPS_PT_estimate, the_photo_has_no_file),
        (MPS_PT_estimate, setting("estimate", model="FILE")),
        (MPS_PT_estimate, setting("estimate", mask="FILE")),
        (MPS_PT_estimate, setting("estimate", mask="BACKGROUND", background="/nowhere/gone.exr")),
        (MPS_PT_estimate, setting("estimate", dark="/nowhere/gone.exr")),
        (MPS_PT_estimate, setting("estimate", albedo=True)),
        (MPS_PT_bake, removing("normals.png")),
        (MPS_PT_bake, no_camera_saw_the_normals),
        (MPS_PT_bake, no_uv_map),
        (MPS_PT_bake, setting("bake", uv_map="Gone")),
        (MPS_PT_bake, lambda *_: bpy.context.object.data.clear_geometry()),
        (MPS_PT_bake, the_target_was_deleted),
        (MPS_PT_bake, no_shader_takes_a_normal),
        (MPS_PT_bake, nothing_is_selected_to_bake_onto),
        (MPS_PT_material, the_photo_measures_nobody_knows_what),
    ],
)
def test_a_step_is_ready_only_where_pressing_it_works(estimated, scene, tmp_path, step, spoil):
    if step is MPS_PT_estimate:
        scene.mps.estimate.image = None
    if step in (MPS_PT_estimate, MPS_PT_bake, MPS_PT_material):
        assert stands(step) == (Kind.READY, "")
    spoil(scene, tmp_path)
    kind, why = stands(step)
    assert kind is Kind.TO_DO and why
    with pytest.raises(RuntimeError):
        getattr(bpy.ops.mps, step.verb(bpy.context))()


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


def test_time_left_is_reported_once_it_can_be_known():
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
