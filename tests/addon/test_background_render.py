"""Renders by a second Blender, a real one: it renders what this one would, and this one stays as it is."""

import itertools
import os
import re
import select
import subprocess
import sys
import time

import bpy
import numpy as np
import pytest

from blender_addon.child_process.core_process import CoreProcess
from blender_addon.photo.background_render import rendering_blender, written_job
from mpsnet_core import InputError, read_camera, read_rig, write_image

from .rendering import pixels, shader_of
from .test_photo import everything, glowing


def begin(what, output, folder):
    """The run that the button would start."""
    folder.mkdir()
    return CoreProcess(written_job(bpy.context, what, output, folder), [output], rendering_blender(folder))


@pytest.fixture
def small(sphere, scene, tmp_path):
    """The sphere with a rig and settings for a small photo, in a saved file."""
    bpy.ops.mps.add_rig()
    scene.mps.photo.width, scene.mps.photo.height, scene.mps.photo.samples = 24, 16, 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    return sphere


def paint(obj, colour, *, is_float=False):
    """Give the object a texture of one colour that is in memory alone."""
    image = bpy.data.images.new("Painted", 4, 4, float_buffer=is_float)
    image.pixels[:] = [*colour, 1] * 16
    textured(obj).image = image
    return image


def textured(obj):
    """A node for a picture that colours the object."""
    tree = obj.active_material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    tree.links.new(texture.outputs["Color"], shader_of(tree).inputs["Base Color"])
    return texture


def test_the_photo_is_the_same_and_this_file_does_not_change(small, scene, tmp_path):
    """With a second scene, which is not the one that is rendered, and paint that was never saved."""
    image = paint(small, (0.9, 0.1, 0.3))
    for tiled in (False, True):  # painted and of no use any more: the copy does not have them
        bpy.data.images.new("Unused", 4, 4, tiled=tiled).pixels[0] = 0.5
    bpy.data.scenes.new("Another")
    bpy.context.view_layer.name = "Mine"
    scene.frame_set(7, subframe=0.25)
    before, dirty = everything(scene), bpy.data.is_dirty
    process = begin("photo", tmp_path / "beside.exr", tmp_path / "job")
    assert everything(scene) == before
    assert image.is_dirty and image.source == "GENERATED" and image.file_format == "PNG"
    assert bpy.data.filepath == str(tmp_path / "mine.blend") and bpy.data.is_dirty == dirty
    written = [str(tmp_path / f"beside.{suffix}") for suffix in ("exr", "rig.json", "camera.json")]
    assert process.result() == {"output": written[0], "written": written, "told": []}
    assert process.progress >= 2 / 3 and process.message == "rendering light 3 of 3"

    bpy.ops.mps.render_photo(output=str(tmp_path / "here.exr"))
    np.testing.assert_allclose(pixels(tmp_path / "beside.exr"), pixels(tmp_path / "here.exr"), atol=1e-6)
    for what, read in (("rig", read_rig), ("camera", read_camera)):
        ours, theirs = (vars(read(tmp_path / f"{name}.{what}.json")) for name in ("here", "beside"))
        np.testing.assert_equal(ours, theirs)


def test_one_copy_of_the_file_is_rendered_by_each_rig_in_turn(small, scene, tmp_path):
    bpy.ops.mps.add_rig_ring(count=2)
    (tmp_path / "job").mkdir()
    work = written_job(bpy.context, "photo", tmp_path / "unused.exr", tmp_path / "job")
    for number in range(3):
        bpy.ops.mps.choose_rig(index=number)
        here, beside = (tmp_path / f"{where}_{number}.exr" for where in ("here", "beside"))
        bpy.ops.mps.render_photo(output=str(here))
        (folder := tmp_path / f"job_{number}").mkdir()
        job = {**work, "rig": number, "output": str(beside)}
        CoreProcess(job, [beside], rendering_blender(folder)).result()
        np.testing.assert_allclose(pixels(beside), pixels(here), atol=1e-6)
        cameras = [vars(read_camera(tmp_path / f"{where}_{number}.camera.json")) for where in ("here", "beside")]
        np.testing.assert_equal(*cameras)


def test_what_a_file_beside_this_one_holds_is_found_from_the_copy(small, scene, tmp_path):
    """A linked object, and a picture on it, by paths relative to this file; and bright paint in numbers above 1."""
    paint(small, (3.0, 0.5, 2.0), is_float=True)
    library = tmp_path / "parts" / "library.blend"
    library.parent.mkdir()
    mesh = small.data.copy()
    mesh.transform(small.matrix_world.Translation((0.5, 0.3, 0)))
    bpy.data.libraries.write(str(library), {bpy.data.objects.new("Part", mesh)}, fake_user=True)
    with bpy.data.libraries.load(str(library), link=True, relative=True) as (_, here):
        here.objects = ["Part"]
    assert bpy.data.libraries[0].filepath.startswith("//")
    scene.collection.objects.link(here.objects[0])
    begin("photo", tmp_path / "beside.exr", tmp_path / "job").result()
    bpy.ops.mps.render_photo(output=str(tmp_path / "here.exr"))
    here = pixels(tmp_path / "here.exr")
    assert here[..., 0].max() > 1.5 * here[..., 1].max()
    np.testing.assert_allclose(pixels(tmp_path / "beside.exr"), here, atol=1e-5)


@pytest.fixture
def linked(small, scene, tmp_path):
    """An object "Part" that is linked beside the sphere, from a library and in a collection of its own."""
    mesh = small.data.copy()
    mesh.transform(small.matrix_world.Translation((0.5, 0.3, 0)))
    part = bpy.data.objects.new("Part", mesh)
    bpy.data.libraries.write(str(tmp_path / "parts.blend"), {part}, fake_user=True)
    bpy.data.objects.remove(part)
    with bpy.data.libraries.load(str(tmp_path / "parts.blend"), link=True, relative=True) as (_, here):
        here.objects = ["Part"]
    parts = bpy.data.collections.new("Parts")
    parts.objects.link(here.objects[0])
    scene.collection.children.link(parts)


def test_a_library_that_is_gone_since_is_reported_and_nothing_is_rendered(linked, scene, tmp_path):
    """This Blender has it in memory, so nobody sees that the copy lacks it."""
    (tmp_path / "parts.blend").rename(tmp_path / "moved.blend")
    lost = f'the library {tmp_path / "parts.blend"}, from which this scene takes "Part", was not found; put it back'
    with pytest.raises(InputError, match=f"^{re.escape(lost)}, find it with .*Find Missing Files, or make .* local$"):
        begin("photo", tmp_path / "photo.exr", tmp_path / "job").result()
    assert not list(tmp_path.glob("*photo*"))

    bpy.data.libraries.write(str(tmp_path / "parts.blend"), {bpy.data.objects["Sphere"]})
    with pytest.raises(InputError, match=r'^"Part" is no longer in the library .*parts\.blend, .*make it local$'):
        begin("photo", tmp_path / "photo.exr", tmp_path / "again").result()


def test_a_library_that_the_photo_does_not_use_or_that_was_missing_before_stops_nothing(linked, scene, tmp_path):
    (tmp_path / "parts.blend").unlink()
    layer = bpy.context.view_layer.layer_collection.children["Parts"]
    layer.exclude = True
    begin("normals", tmp_path / "excluded.exr", tmp_path / "excluded").result()
    layer.exclude = False
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert bpy.context.scene.objects["Part"].is_missing
    begin("normals", tmp_path / "missing.exr", tmp_path / "missing").result()


def test_pictures_whose_files_are_gone_since_are_as_they_are_here(small, scene, tmp_path):
    """One of bytes, and one of floats beyond 1."""
    beside = small.copy()
    beside.data, beside.location.x = small.data.copy(), small.location.x + 1
    beside.data.materials[0] = small.active_material.copy()
    scene.collection.objects.link(beside)
    files = [tmp_path / "paint.png", tmp_path / "paint.exr"]
    for obj, file, colour in zip((small, beside), files, ((0.9, 0.1, 0.3), (3.0, 0.5, 2.0)), strict=True):
        write_image(file, np.full((4, 4, 3), colour, np.float32))
        textured(obj).image = bpy.data.images.load(str(file))
    begin("photo", tmp_path / "there.exr", tmp_path / "there").result()
    for file in files:
        image = bpy.data.images[file.name]
        assert image.pixels[0] and image.has_data
        file.unlink()
    begin("photo", tmp_path / "gone.exr", tmp_path / "gone").result()
    np.testing.assert_allclose(pixels(tmp_path / "gone.exr"), pixels(tmp_path / "there.exr"), rtol=1e-4, atol=1e-5)


def fallen_cloth(scene):
    """The cache on the disk of a cloth that falls beside the sphere for twelve frames."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=1, location=(0.7, -1.2, 0))
    cloth = bpy.context.object
    cache = cloth.modifiers.new("Cloth", "CLOTH").point_cache
    cache.frame_end = scene.frame_end = 12
    bpy.ops.wm.save_mainfile()
    cache.use_disk_cache = True
    with bpy.context.temp_override(point_cache=cache):
        bpy.ops.ptcache.bake(bake=True)
    return cache


def test_what_simulations_have_on_disk_is_there_in_the_copy(small, scene, tmp_path):
    """Cloth that has fallen beside the sphere, a frame at a time, is as far down as here."""
    fallen_cloth(scene)
    scene.frame_set(12)
    kept = sorted((tmp_path / "blendcache_mine").iterdir())
    begin("normals", tmp_path / "beside.exr", tmp_path / "job").result()
    bpy.ops.mps.render_truth(output=str(tmp_path / "here.exr"))
    np.testing.assert_allclose(pixels(tmp_path / "beside.exr"), pixels(tmp_path / "here.exr"), atol=1e-5)
    # Geometry nodes name the folder in full, by where it lies from the file.
    assert (tmp_path / "job" / "mine.blend").is_file() and (tmp_path / "job" / "blendcache_mine").is_dir()
    assert kept and sorted((tmp_path / "blendcache_mine").iterdir()) == kept


def lifting(obj, folder, *, by_hand):
    """Geometry nodes that lift the object by a bake alone: `folder` has it, for all bakes or for this one by hand."""
    tree = bpy.data.node_groups.new("Lift", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeTransform", "GeometryNodeBake", "NodeGroupOutput")
    nodes = [tree.nodes.new(kind) for kind in kinds]
    if not nodes[2].bake_items:
        nodes[2].bake_items.new("GEOMETRY", "Geometry")
    for one, other in itertools.pairwise(nodes):
        tree.links.new(one.outputs[0], other.inputs[0])
    nodes[1].inputs["Translation"].default_value = (0, 0, 0.5)
    modifier = obj.modifiers.new("Lift", "NODES")
    modifier.node_group = tree
    bpy.context.view_layer.update()
    bake = modifier.bakes[0]
    bake.bake_mode, bake.bake_target, bake.use_custom_path = "STILL", "DISK", by_hand
    setattr(*((bake, "directory") if by_hand else (modifier, "bake_directory")), folder)
    bpy.ops.object.geometry_node_bake_single(session_uid=obj.session_uid, modifier_name="Lift", bake_id=bake.bake_id)
    nodes[1].inputs["Translation"].default_value = (0, 0, 0)


def test_caches_and_bakes_in_folders_that_were_named_by_hand_are_found_from_the_copy(small, scene, tmp_path):
    """Cloth that has fallen, read from an external folder, and two cubes that a bake of geometry nodes lifts."""
    cache = fallen_cloth(scene)
    (tmp_path / "blendcache_mine").rename(tmp_path / "ext")
    cache.use_external, cache.index, cache.filepath = True, 0, "//ext"
    cache.name = next((tmp_path / "ext").iterdir()).name.split("_")[0]
    for by_hand in (False, True):
        bpy.ops.mesh.primitive_cube_add(size=0.3, location=(0.6 * by_hand - 0.3, -1.2, 0.2))
        lifting(bpy.context.object, f"//bakes/{by_hand}", by_hand=by_hand)
    scene.frame_set(12)
    kept = sorted((tmp_path / "ext").iterdir()) + sorted((tmp_path / "bakes").rglob("*"))
    assert "points found" in cache.info and len(kept) > 12
    begin("normals", tmp_path / "beside.exr", tmp_path / "job").result()
    bpy.ops.mps.render_truth(output=str(tmp_path / "here.exr"))
    np.testing.assert_allclose(pixels(tmp_path / "beside.exr"), pixels(tmp_path / "here.exr"), atol=1e-5)
    assert sorted((tmp_path / "ext").iterdir()) + sorted((tmp_path / "bakes").rglob("*")) == kept


def test_frames_and_true_normals_too(small, scene, tmp_path):
    scene.frame_start, scene.frame_end = 3, 4
    small.keyframe_insert("scale", frame=3)
    small.scale *= 0.5
    small.keyframe_insert("scale", frame=4)
    (tmp_path / "shots").mkdir()
    first = begin("frames", tmp_path / "shots", tmp_path / "frames").result()["output"]
    assert first == str(tmp_path / "shots" / "shots_0003.exr")
    areas = [(pixels(file)[..., 3] > 0.5).sum() for file in sorted((tmp_path / "shots").glob("*.exr"))]
    assert len(areas) == 2 and 0 < areas[1] < 0.5 * areas[0]

    begin("normals", tmp_path / "truth.exr", tmp_path / "normals").result()
    bpy.ops.mps.render_truth(output=str(tmp_path / "here.exr"))
    np.testing.assert_allclose(pixels(tmp_path / "truth.exr"), pixels(tmp_path / "here.exr"), atol=1e-5)


def test_what_the_other_blender_refuses_is_its_own_sentence(small, tmp_path):
    small.material_slots[0].material = glowing()
    with pytest.raises(InputError, match=r'material "Lamp" of "Sphere" glows.*set its emission to 0'):
        begin("photo", tmp_path / "photo.exr", tmp_path / "job").result()
    assert not list(tmp_path.glob("photo*")) and not list(tmp_path.glob(".*"))


def test_a_copy_that_cannot_be_written_is_said_in_one_sentence(small, tmp_path):
    with pytest.raises(InputError, match=r"cannot write .*mine\.blend \(.*\); make room for a copy"):
        written_job(bpy.context, "photo", tmp_path / "photo.exr", tmp_path / "nowhere")


def test_cancelling_ends_it_in_the_middle_of_a_render_and_leaves_nothing(small, scene, tmp_path):
    scene.mps.photo.samples = 65536
    scene.mps.photo.width = scene.mps.photo.height = 1024
    for what in ("photo", "normals"):
        folder = tmp_path / what
        process = begin(what, tmp_path / f"{what}.exr", folder)
        while process.running() and process.progress == 0:  # the first sample of the first light is there
            time.sleep(0.01)
        assert process.running() and "rendering" in process.message
        start = time.monotonic()
        process.cancel()
        assert not process.running() and time.monotonic() - start < 10
        assert not list(tmp_path.glob(f"*{what}.*exr"))


# A Blender that is killed in the middle of a render. The last thing that it prints is the rendering one's process ID.
KILLED = """
import os, signal, sys, time
from pathlib import Path
import bpy
import blender_addon
from blender_addon.child_process.core_process import CoreProcess
from blender_addon.photo.background_render import rendering_blender, written_job
blender_addon.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
folder, output = Path(sys.argv[2]), Path(sys.argv[3])
process = CoreProcess(written_job(bpy.context, "photo", output, folder), [output], rendering_blender(folder))
while process.running() and process.progress == 0:
    time.sleep(0.01)
print(process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs Linux")
def test_where_blender_is_killed_the_one_that_renders_ends_too(small, scene, tmp_path):
    scene.mps.photo.samples = 65536
    scene.mps.photo.width = scene.mps.photo.height = 1024
    bpy.ops.wm.save_mainfile()
    (tmp_path / "job").mkdir()
    places = tmp_path / "mine.blend", tmp_path / "job", tmp_path / "photo.exr"
    killed = subprocess.Popen([sys.executable, "-c", KILLED, *map(str, places)], stdout=subprocess.PIPE, text=True)
    with killed, os.fdopen(os.pidfd_open(int(list(killed.stdout)[-1])), "rb") as rendering:
        assert select.select([rendering], [], [], 10)[0], "it still renders"
    assert not list(tmp_path.glob("*photo*"))
