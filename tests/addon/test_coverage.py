"""Coverage: what the bake's views saw, in words and on the object."""

import re

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.images import pixels_of
from blender_addon.settings.record import notes_of

from .rendering import pixels


@pytest.fixture
def baked(estimated, scene, tmp_path):
    bpy.ops.mps.bake(size=64, fill=True, output=str(tmp_path / "texture.png"))
    return estimated


def test_the_share_seen_stays_with_the_step_and_is_that_of_the_map(baked, scene, tmp_path):
    (note,) = [note for note in notes_of(scene, "bake") if "of the surface seen" in note]
    kept = scene.mps.bake.image.mps.coverage
    assert kept.packed_file and tuple(kept.size) == (64, 64)  # the texture's folder is not littered
    assert not [file for file in tmp_path.iterdir() if "coverage" in file.name]
    coverage = pixels_of(kept)[..., 0]
    seen, filled = ((np.abs(coverage - level) < 0.01).mean() for level in (1, 0.5))
    assert 0.2 < seen < 0.6 and seen + filled > 0.99
    # The sphere's UVs fill the texture but for a few corners at its poles.
    shares = [int(share) / 100 for share in re.fullmatch("(.*)% of the surface seen, (.*)% filled", note).groups()]
    assert shares == pytest.approx([seen, filled], abs=0.02)
    bpy.ops.mps.bake(output=str(tmp_path / "texture.png"))
    assert len([image for image in bpy.data.images if image.name.startswith("MPS Sphere Coverage")]) == 1


def test_a_mesh_that_was_moved_after_the_photo_is_hardly_seen_and_the_note_asks(baked, scene):
    asks = "was the object or the camera moved since the photo?"
    assert asks not in "".join(notes_of(scene, "bake"))
    baked.data.transform(Matrix.Translation((1.55, 0, 0)))  # all but its edge is beside where it was in the photo
    bpy.ops.mps.bake(anyway=True)
    (note,) = [note for note in notes_of(scene, "bake") if "of the surface seen" in note]
    assert int(note.split("%")[0]) < 10 and note.endswith(f"filled; {asks}")
    baked.data.transform(Matrix.Translation((0.25, 0, 0)))  # nothing of it that is seen faces the camera
    with pytest.raises(RuntimeError, match=r"lands in the texture.* Was the object or the camera moved"):
        bpy.ops.mps.bake()


def look(scene, path):
    """(H, W, 3) what the rig's camera sees of the viewport's objects by daylight."""
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy = 3
    bpy.context.view_layer.update()
    sun.matrix_world = scene.mps.rig.camera.matrix_world
    scene.collection.objects.link(sun)
    lights = [light.object for light in scene.mps.rig.lights]
    for light in lights:
        light.hide_render = True
    render = scene.render
    render.engine, scene.cycles.samples = "CYCLES", 4
    render.resolution_x = render.resolution_y = 64
    render.image_settings.file_format, render.filepath = "OPEN_EXR", str(path)
    scene.camera = scene.mps.rig.camera
    bpy.ops.render.render(write_still=True)
    for light in lights:
        light.hide_render = False
    bpy.data.objects.remove(sun)
    return pixels(path)[..., :3]


def test_coverage_is_shown_on_the_object_and_taken_off_without_a_trace(baked, scene, tmp_path):
    material = baked.material_slots[0].material
    before = (set(bpy.data.objects), set(bpy.data.materials), set(bpy.data.meshes), len(material.node_tree.nodes))
    bpy.ops.mps.show_coverage()
    (overlay,) = set(bpy.data.objects) - before[0]
    assert overlay.hide_render and overlay.hide_select
    assert baked.material_slots[0].material == material and baked.data.materials[0] == material
    # Renders do not show it; what the viewport shows is looked at by one that does.
    overlay.hide_render = False
    front = look(scene, tmp_path / "front.exr")[32, 32]
    scene.mps.rig.target.rotation_euler.z += np.pi
    behind = look(scene, tmp_path / "behind.exr")[32, 32]
    assert front[1] > 2 * front[0]  # green: the photo was taken from here
    assert behind[0] > 1.5 * behind[1] > 1.5 * behind[2]  # orange: nobody looked from here, so it was filled
    bpy.ops.mps.show_coverage()
    assert before == (
        set(bpy.data.objects),
        set(bpy.data.materials),
        set(bpy.data.meshes),
        len(material.node_tree.nodes),
    )
    assert not scene.mps.bake.overlays


def test_the_photo_and_the_next_bake_go_on_below_the_coverage(baked, scene, tmp_path):
    shots = []
    for name in ("before.exr", "below.exr"):
        bpy.ops.mps.render_photo(width=96, height=96, samples=16, output=str(tmp_path / name))
        shots.append(pixels(tmp_path / name))
        if name == "before.exr":
            bpy.ops.mps.show_coverage()
    np.testing.assert_allclose(*shots, atol=1e-3)
    bpy.ops.mps.bake(size=64, output=str(tmp_path / "texture.png"))
    assert baked.material_slots[0].material.node_tree.nodes["MPS Texture"].image == scene.mps.bake.image
    bpy.ops.mps.show_coverage()
    assert not [obj for obj in bpy.data.objects if obj.name.startswith("MPS Coverage")]


def test_coverage_survives_the_file_and_its_copys_deletion(baked, scene, tmp_path):
    bpy.ops.mps.show_coverage()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shown.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shown.blend"))
    bpy.data.objects.remove(bpy.context.scene.mps.bake.overlays[0].object)
    bpy.context.scene.mps.bake.shading = '["nowhere", 99, {}]'
    bpy.ops.mps.show_coverage()
    assert not bpy.context.scene.mps.bake.overlays and bpy.context.scene.mps.bake.shading == ""


def test_before_the_bake_there_is_none(estimated):
    assert not bpy.ops.mps.show_coverage.poll()


@pytest.mark.parametrize("show", ["relight", "show_coverage"])
def test_a_slot_without_a_baked_texture_stays_as_it_is(baked, scene, tmp_path, show):
    """It does not count as another object's either, which a bake would leave its material to."""
    plain = bpy.data.materials.new("Plain")
    baked.data.materials.append(plain)
    before, materials = set(bpy.data.objects), list(baked.data.materials)
    getattr(bpy.ops.mps, show)()
    (overlay,) = [one for one in set(bpy.data.objects) - before if one.type == "MESH"]
    assert overlay.material_slots[0].material != materials[0] and overlay.material_slots[1].material in (None, plain)
    bpy.ops.mps.bake(output=str(tmp_path / "again.png"))
    assert list(baked.data.materials) == materials
