"""What happens to a bake when its object, camera or mesh changed after the photo."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.step import Kind
from blender_addon.photo.align import _camera_object
from blender_addon.photo.camera import take_pairs_along
from blender_addon.scene.camera import scene_camera
from blender_addon.settings.record import result_of
from mpsnet_core import InputError, NormalMap, read_camera, read_normals, write_normals

from .rendering import pixels

MOTIONS = {
    "moved": Matrix.Translation((1, 0.3, -2)),
    "turned": Euler((0.4, 1.2, -0.3)).to_matrix().to_4x4(),
    "scaled": Matrix.Scale(2.5, 4),
    "stretched": Matrix.Diagonal((1, 1.5, 0.7, 1)),
}


def bake(scene, tmp_path, name="texture.exr", **settings):
    bpy.ops.mps.bake(size=64, output=str(tmp_path / name), **settings)
    return pixels(tmp_path / name)[..., :3], result_of(scene.mps, "bake")["seen"]


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_an_object_that_moves_keeps_its_bake(estimated, scene, tmp_path, motion):
    before, seen = bake(scene, tmp_path)
    estimated.matrix_world = motion @ estimated.matrix_world
    bpy.context.view_layer.update()
    assert MPS_PT_bake.state(bpy.context).kind is Kind.DONE
    after, seen_after = bake(scene, tmp_path, "after.exr")
    assert seen_after == pytest.approx(seen, abs=0.01)
    assert np.abs(after - before).mean() < 1e-3


def test_an_object_put_into_the_photos_place_is_baked_there(estimated, scene, tmp_path):
    right, _ = bake(scene, tmp_path)
    low = estimated.copy()
    low.data = estimated.data.copy()
    scene.collection.objects.link(low)
    low.location = (8, 0, 0)  # beside the photo
    bpy.context.view_layer.update()
    bpy.ops.mps.render_photo(width=96, height=96, samples=16, output=str(tmp_path / "again.exr"))
    bpy.ops.mps.estimate(output=str(tmp_path / "again.png"))
    low.location = (0, 0, 0)
    found, _ = bake(scene, tmp_path, "low.exr", target=low.name)
    assert np.abs(found - right).mean() < 5e-3


def test_a_hidden_target_in_the_photos_place_stays_with_it(sphere, scene, tmp_path):
    """As in the demo: the photo shows the detailed object, the target is hidden there."""
    low = sphere.copy()
    low.data = sphere.data.copy()
    scene.collection.objects.link(low)
    low.hide_render = True
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=96, height=96, samples=16, output=str(tmp_path / "photo.exr"))
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    before, seen = bake(scene, tmp_path, target=low.name)
    low.location = (3, 1, 0)
    after, seen_after = bake(scene, tmp_path, "after.exr")
    assert seen_after == pytest.approx(seen, abs=0.01) and np.abs(after - before).mean() < 1e-3


def test_a_changed_mesh_is_out_of_date(estimated, scene, tmp_path):
    bake(scene, tmp_path)
    mesh = estimated.data
    top = mesh.vertices[0].co.copy()
    mesh.vertices[0].co.z += 0.5
    assert MPS_PT_bake.state(bpy.context).kind is Kind.OUT_OF_DATE
    mesh.vertices[0].co = top
    assert MPS_PT_bake.state(bpy.context).kind is Kind.DONE
    for loop in mesh.uv_layers.active.uv:
        loop.vector = loop.vector * 0.5
    assert MPS_PT_bake.state(bpy.context).kind is Kind.OUT_OF_DATE


def test_a_good_texture_is_not_overwritten_by_a_poor_one(estimated, scene, tmp_path):
    good, seen = bake(scene, tmp_path)
    cut(scene, tmp_path)
    with pytest.raises(RuntimeError, match="less-seen"):
        bake(scene, tmp_path)
    assert np.array_equal(pixels(tmp_path / "texture.exr")[..., :3], good)
    poor, seen_then = bake(scene, tmp_path, anyway=True)
    assert seen_then < 0.6 * seen and not np.array_equal(poor, good)
    bake(scene, tmp_path)  # as much as the one that is there now


def cut(scene, tmp_path):
    """Let the normals show a quarter of the sphere alone."""
    file = tmp_path / "normals.png"
    normals = read_normals(file)
    mask = normals.mask.copy()
    mask[48:] = mask[:, 48:] = False
    write_normals(file, NormalMap(normals.vectors, mask))


def test_points_picked_on_an_object_move_with_it(estimated, scene):
    photo = scene.mps.photo.image
    photo.mps.pairs.add().point = (0.5, 0, 0)
    take_pairs_along(photo, estimated)
    estimated.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Scale(2, 4)
    for _ in range(2):
        take_pairs_along(photo, estimated)
        assert np.allclose(photo.mps.pairs[0].point, (2, 2, 3), atol=1e-6)


def test_other_lights_make_the_estimate_of_a_real_photo_out_of_date(estimated, scene, tmp_path):
    for what in ("rig", "camera"):
        (tmp_path / f"photo.{what}.json").unlink()
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    bpy.ops.mps.estimate()
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    scene.mps.rig.lights[0].object.location.x += 2
    scene.mps.rig.lights[0].object.rotation_euler.y += 0.3
    bpy.context.view_layer.update()
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.OUT_OF_DATE


def test_the_aligned_camera_belongs_to_the_object(estimated, scene, tmp_path):
    photo = scene.mps.photo.image
    found = read_camera(tmp_path / "photo.camera.json")
    camera = _camera_object(scene, photo, found, estimated)
    bpy.context.view_layer.update()
    assert np.allclose(camera.matrix_world, found.world_from_camera, atol=1e-5)
    estimated.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Scale(2, 4)
    bpy.context.view_layer.update()
    assert np.allclose(camera.matrix_world.translation, Vector(found.world_from_camera[:3, 3]) * 2 + Vector((1, 2, 3)))
    estimated.scale = (2, 3, 2)
    bpy.context.view_layer.update()
    with pytest.raises(InputError, match="stretched"):
        scene_camera(camera, scene)
