"""Renders by a second Blender, a real one: it renders what this one would, and this one stays as it is."""

import time

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.core_process import CoreProcess
from blender_addon.render_beside import rendering_blender, written_job
from mpsnet_core.camera import read_camera
from mpsnet_core.errors import InputError
from mpsnet_core.rig import read_rig

from .test_photo import everything, glowing


def begin(what, output, folder):
    """The run that the button would start."""
    folder.mkdir()
    return CoreProcess(written_job(bpy.context, what, output, folder), [output], rendering_blender(folder))


def pixels(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


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
    tree = obj.active_material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    return image


def test_the_photo_is_the_same_and_this_file_does_not_change(small, scene, tmp_path):
    """With a second scene, which is not the one that is rendered, and paint that was never saved."""
    image = paint(small, (0.9, 0.1, 0.3))
    bpy.data.scenes.new("Another")
    bpy.context.view_layer.name = "Mine"
    scene.frame_set(7, subframe=0.25)
    before, dirty = everything(scene), bpy.data.is_dirty
    process = begin("photo", tmp_path / "beside.exr", tmp_path / "job")
    assert everything(scene) == before
    assert image.is_dirty and image.source == "GENERATED" and image.file_format == "PNG"
    assert bpy.data.filepath == str(tmp_path / "mine.blend") and bpy.data.is_dirty == dirty
    assert process.result() == {"output": str(tmp_path / "beside.exr")}
    assert process.progress >= 2 / 3 and process.message == "rendering light 3 of 3"

    bpy.ops.mps.render_photo(output=str(tmp_path / "here.exr"))
    np.testing.assert_allclose(pixels(tmp_path / "beside.exr"), pixels(tmp_path / "here.exr"), atol=1e-6)
    for what, read in (("rig", read_rig), ("camera", read_camera)):
        ours, theirs = (vars(read(tmp_path / f"{name}.{what}.json")) for name in ("here", "beside"))
        np.testing.assert_equal(ours, theirs)


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


def test_paint_that_nothing_uses_does_not_matter(small, tmp_path):
    """A copy of the file does not hold it."""
    for tiled in (False, True):
        bpy.data.images.new("Left over", 4, 4, tiled=tiled).pixels[:] = [0.5] * 64
    assert all(image.is_dirty for image in bpy.data.images if image.name.startswith("Left over"))
    begin("normals", tmp_path / "truth.exr", tmp_path / "job").result()


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
    with pytest.raises(InputError, match=r"cannot write .*scene\.blend \(.*\); make room for a copy"):
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
