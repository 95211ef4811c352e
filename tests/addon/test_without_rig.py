"""A photo without a rig: its lights are found in it, or by the mesh that it shows; and Scan, which does all of it."""

import shutil

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from mirror_ball import Scene, around, lamps_around, photograph
from synthetic import degrees_between

from blender_addon.panels import CLASSES
from blender_addon.panels.bake import MPS_PT_bake, lacks_targets
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.lights import MPS_PT_lights
from blender_addon.panels.material import MPS_PT_material
from blender_addon.panels.photo import MPS_PT_align, MPS_PT_photo
from blender_addon.panels.photo_inputs import lights_of
from blender_addon.panels.rig import MPS_PT_rig
from blender_addon.panels.start import MPS_PT_start
from blender_addon.panels.step import Kind, Step
from blender_addon.scene.camera import scene_camera
from blender_addon.settings.record import notes_of
from mpsnet_core import read_camera, read_rig, write_image

from .rendering import STATUE

ANGLES = [(35, 80), (50, 200), (42, 320)]


@pytest.fixture
def unlit(opened):
    """The statue's photo, of which neither the lights nor the camera are known."""
    opened.mps.estimate.rig_file = ""
    return opened


def off(rig, shot):
    return degrees_between(rig.directions, read_rig(shot / "rig.json").directions).max()


def test_a_photo_is_estimated_without_a_rig_which_then_shows_its_lights(unlit, shot, tmp_path):
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.READY
    assert MPS_PT_align.lacks(bpy.context) == "" == MPS_PT_lights.lacks(bpy.context)
    assert lights_of(unlit).rig is None
    bpy.ops.mps.estimate(output=str(tmp_path / "normals.exr"))
    lights = lights_of(unlit)
    assert off(lights.rig, shot) < 2 * lights.error < 60
    assert f"± {lights.error:.0f}°" in lights.words
    assert any("lights found in the photo" in note for note in notes_of(unlit, "estimate"))
    another = shutil.copy(shot / "photo.exr", tmp_path / "another.exr")
    bpy.ops.mps.open_photo(filepath=str(another))
    assert lights_of(unlit).rig is None


def test_a_flat_material_still_asks_for_its_lights(unlit):
    unlit.mps.material.width = 1.0
    assert MPS_PT_material.lacks(bpy.context).startswith("Where are the lights?")
    with pytest.raises(RuntimeError, match="where this photo's lights are"):
        bpy.ops.mps.make_material()


def test_the_lights_of_the_photo_become_its_rig(unlit, shot, tmp_path):
    rig = tmp_path / "rig.json"
    bpy.ops.mps.calibrate_lights(source="PHOTO", output=str(rig))
    assert off(read_rig(rig), shot) < 25
    assert unlit.mps.estimate.rig_file == str(rig) and lights_of(unlit).rig is not None
    assert [row.split("|")[0] for row in unlit.mps.calibrate.summary.splitlines()] == ["", "Red", "Green", "Blue"]
    assert MPS_PT_lights.state(bpy.context).kind is Kind.DONE


def test_the_mesh_in_the_photo_tells_its_lights(unlit, shot, tmp_path):
    with pytest.raises(RuntimeError, match="Align Photo"):
        bpy.ops.mps.calibrate_lights(source="MESH")
    unlit.mps.photo.image["mpsnet_camera"] = (shot / "true.json").read_text()
    bpy.ops.mps.calibrate_lights(source="MESH", output=str(tmp_path / "rig.json"))
    assert off(read_rig(tmp_path / "rig.json"), shot) < 5


def test_three_photos_of_a_ball_under_one_lamp_each(scene, tmp_path):
    balls = Scene([((0.0, 0.0, 0.0), 110.0)], lamps_around((0, 0, 0), 2e4, angles=ANGLES), (300, 300))
    photos = []
    for light in range(3):
        alone = np.zeros((3, 3))
        alone[:, light] = 1  # white lamps
        photos.append(str(tmp_path / f"ball_{light}.exr"))
        write_image(tmp_path / f"ball_{light}.exr", photograph(balls, alone))
    names = dict(zip(("ball", "second_light", "third_light"), photos, strict=True))
    bpy.ops.mps.calibrate_lights(source="LAMPS", **names, output=str(tmp_path / "rig.json"))
    found = read_rig(tmp_path / "rig.json").directions
    assert degrees_between(found, np.array([around(*angle) for angle in ANGLES])).max() < 1


def test_who_photographs_begins_with_the_photo(scene):
    def steps():
        shown = [step for step in CLASSES if issubclass(step, Step) and step.poll(bpy.context)]
        return [step for step in shown if not getattr(step, "bl_parent_id", "")][:3]

    assert scene.mps.way == "PHOTOGRAPH" and steps() == [MPS_PT_start, MPS_PT_photo, MPS_PT_lights]
    assert MPS_PT_photo.state(bpy.context).kind is Kind.READY
    scene.mps.way = "RENDER"
    assert steps() == [MPS_PT_start, MPS_PT_rig, MPS_PT_photo]


# --- scan -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def bare(unlit):
    """The statue without UVs, selected, with its photo."""
    target = unlit.mps.bake.target
    while target.data.uv_layers:
        target.data.uv_layers.remove(target.data.uv_layers[0])
    unlit.mps.bake.size = 64
    return target


def test_unwrap_gives_uvs_and_leaves_the_selection(bare, unlit):
    bare.modifiers.clear()  # the panel asks no modifier whether it makes UVs
    assert "press Unwrap" in lacks_targets(bpy.context)
    before = unlit.view_layers[0].objects.active, [*bpy.context.view_layer.objects.selected]
    bpy.ops.mps.unwrap()
    assert lacks_targets(bpy.context) == ""
    assert (unlit.view_layers[0].objects.active, [*bpy.context.view_layer.objects.selected]) == before
    uvs = np.zeros(2 * len(bare.data.loops), np.float32)
    bare.data.uv_layers[0].uv.foreach_get("vector", uvs)
    assert uvs.min() >= 0 and uvs.max() <= 1 and np.ptp(uvs.reshape(-1, 2), axis=0).min() > 0.5
    with pytest.raises(RuntimeError, match="delete its UV map"):
        bpy.ops.mps.unwrap()


def test_scan_goes_from_a_photo_and_a_mesh_to_the_texture(bare, unlit, shot):
    bpy.ops.mps.scan()
    mps = unlit.mps
    true, found = read_camera(shot / "true.json"), scene_camera(mps.photo.image.mps.camera, unlit, STATUE)
    assert degrees_between(found.rotation, true.rotation).max() < 1
    assert off(lights_of(unlit).rig, shot) < 6
    assert [step.state(bpy.context).kind for step in (MPS_PT_photo, MPS_PT_lights, MPS_PT_estimate, MPS_PT_bake)] == [
        Kind.DONE
    ] * 4
    (material,) = {slot.material for slot in bare.material_slots}
    assert any(getattr(node, "image", None) == mps.bake.image for node in material.node_tree.nodes)
    # What is known is kept: a second press uses the camera and the rig as they are.
    camera, rig = mps.photo.image.mps.camera.matrix_world.copy(), mps.estimate.rig_file
    bpy.ops.mps.scan()
    assert mps.photo.image.mps.camera.matrix_world == camera and mps.estimate.rig_file == rig


def test_scan_says_what_it_needs(scene, tmp_path):
    with pytest.raises(RuntimeError, match="open a photo"):
        bpy.ops.mps.scan()
    write_image(tmp_path / "photo.exr", np.full((32, 32, 3), 0.5, np.float32))
    with pytest.raises(RuntimeError, match="mesh object"):
        bpy.ops.mps.scan(photo=str(tmp_path / "photo.exr"))


def test_scan_stops_where_the_mesh_does_not_fit(bare, unlit):
    bare.data.transform(Matrix.Diagonal((1, 1, 4, 1)))
    with pytest.raises(RuntimeError, match="fits the photo poorly"):
        bpy.ops.mps.scan()
    assert not unlit.mps.estimate.rig_file and unlit.mps.estimate.image is None
    assert unlit.mps.photo.image.mps.camera is not None  # to be looked through


def test_scan_aligns_anew_with_another_mesh(bare, unlit):
    """The camera that an earlier mesh was aligned by says nothing about this one."""
    camera = bpy.data.objects.new("photo", bpy.data.cameras.new("photo"))
    unlit.collection.objects.link(camera)
    camera.parent, unlit.mps.photo.image.mps.camera, unlit.mps.photo.image.mps.fit = bare, camera, "good"
    bpy.ops.mesh.primitive_cube_add()
    unlit.mps.bake.target = None
    with pytest.raises(RuntimeError, match="fits the photo poorly"):
        bpy.ops.mps.scan()
