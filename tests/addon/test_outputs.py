"""Where results are kept: beside the photo what stood when it was taken, in the .blend what would go with Blender."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from mpsnet_core.camera import read_camera
from mpsnet_core.normals import angular_error, read_normals
from mpsnet_core.rig import read_rig


def pixels(image):
    values = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(values)
    return values


def test_the_photo_keeps_the_rig_and_camera_it_was_taken_with(photographed, scene, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "before.png"))
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "before_texture.png"))
    rig = scene.mps.rig
    rig.lights[0].object.location = (3, 1, 2)
    rig.camera.location.x += 0.5
    bpy.ops.mps.estimate(output=str(tmp_path / "after.png"))
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "after_texture.png"))
    for name in ("{}.png", "{}_texture.png"):
        assert (tmp_path / name.format("after")).read_bytes() == (tmp_path / name.format("before")).read_bytes()
    assert read_rig(tmp_path / "photo.rig.json").slants == pytest.approx([30, 30, 30], abs=1e-3)
    assert read_camera(tmp_path / "after.camera.json").width == 96
    # A new photo is taken with the rig as it stands now.
    bpy.ops.mps.render_photo(output=str(tmp_path / "photo.exr"))
    assert abs(read_rig(tmp_path / "photo.rig.json").slants[0] - 30) > 5


def test_a_matte_sphere_is_estimated_within_half_a_degree_where_all_lights_reach(photographed, scene, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "n.exr"), confidence=True)
    estimate = read_normals(tmp_path / "n.exr")
    camera = read_camera(tmp_path / "n.camera.json")
    x = (np.arange(96) + 0.5 - camera.centre[0]) / camera.focal[0]
    y = (camera.centre[1] - np.arange(96) - 0.5) / camera.focal[1]
    x, y = np.meshgrid(x, y)
    truth = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], -1)
    lit = (truth @ read_rig(tmp_path / "photo.rig.json").directions.T > 0.05).all(-1) & (x**2 + y**2 < 0.95)
    assert lit.sum() > 2000
    assert angular_error(estimate.vectors, truth)[lit].mean() < 0.5


def test_results_of_an_unsaved_file_are_packed_and_outlive_it(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=32, height=32, samples=1)
    first = pixels(scene.mps.photo.image)
    bpy.ops.mps.add_rig(slant=50.0)
    bpy.ops.mps.render_photo()
    assert not np.allclose(pixels(scene.mps.photo.image), first), "the image still shows the first photo"
    bpy.ops.mps.estimate()
    bpy.ops.mps.bake(size=32)
    before = pixels(scene.mps.bake.image)
    names = [Path(image.filepath) for image in (scene.mps.photo.image, scene.mps.bake.image)]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for name in names:
        Path(bpy.path.abspath(str(name))).unlink()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    assert np.array_equal(pixels(scene.mps.bake.image), before)
    bpy.ops.mps.estimate(output=str(tmp_path / "again.png"))
    assert read_normals(tmp_path / "again.png").mask.any()


def test_a_glowing_material_is_refused(sphere, tmp_path):
    bpy.ops.mps.add_rig()
    sphere.material_slots[0].material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 1
    with pytest.raises(RuntimeError, match=r'material "Matte" of "Sphere" glows.*set its emission to 0'):
        bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
