"""The light preview: it follows lights, camera and object, and leaves nothing."""

import time
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.rig import light_preview as module
from blender_addon.rig.light_preview import PIXELS, light_preview, tick

PATIENCE = 300  # seconds


@pytest.fixture
def lit(sphere, scene):
    """The sphere with a rig and its preview; what the picture shows of it, a quarter of a second after each change."""
    bpy.ops.mps.add_rig(projection="ORTHOGRAPHIC", slant=40, tilt=90)
    bpy.ops.mps.light_preview()
    yield sphere
    module.end()


def settled():
    """The two pictures, (H, W, 4) each with the top row first, once nothing is left to be traced; None without any."""
    bpy.context.view_layer.update()
    deadline, quiet = time.monotonic() + PATIENCE, 0
    while quiet < 3:
        assert time.monotonic() < deadline
        tick()
        preview = light_preview()
        if preview is None:
            return None
        quiet = 0 if preview.process is not None else quiet + 1
        time.sleep(0.02)
    found = []
    for icon in preview.icons.values():
        pixels = np.empty((PIXELS, PIXELS, 4), np.float32)
        icon.image_pixels_float.foreach_get(pixels.ravel())
        found.append(pixels[::-1])
    return found


def brightest(picture, channel):
    """(2,) where a channel is brightest, from the picture's middle to the right and up, in halves of its side."""
    level = picture[..., channel]
    row, column = np.nonzero(level > 0.98 * level.max())
    return np.array([column.mean(), PIXELS - row.mean()]) / (PIXELS / 2) - 1


def test_the_picture_follows_a_light_the_camera_and_the_object(lit, scene):
    photo, normals = settled()
    assert photo[PIXELS // 2, PIXELS // 2, 3] == 1 and photo[0, 0, 3] == 0
    assert np.allclose(normals[PIXELS // 2, PIXELS // 2], (0.5, 0.5, 1, 1), atol=0.02)
    assert brightest(photo, 0)[1] > 0.3 > abs(brightest(photo, 0)[0])  # red from above
    scene.mps.rig.lights[0].object.location.y *= -1
    assert brightest(settled()[0], 0)[1] < -0.3  # red from below
    covered = settled()[0][..., 3].mean()
    scene.mps.rig.camera.data.ortho_scale *= 2
    assert settled()[0][..., 3].mean() == pytest.approx(covered / 4, rel=0.05)
    for vertex in lit.data.vertices:
        vertex.co.z *= 0.5
    lit.data.update()
    assert settled()[0][..., 3].mean() == pytest.approx(covered / 8, rel=0.05)
    lit.scale.z = 2
    assert settled()[0][..., 3].mean() == pytest.approx(covered / 4, rel=0.05)


def test_of_what_casts_a_shadow_the_bakes_target_is_no_part(lit, scene):
    whole = settled()[1]
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1.5)
    scene.mps.bake.target = bpy.context.object
    assert np.array_equal(settled()[1], whole)
    scene.mps.bake.target = None
    assert settled()[1][..., 3].sum() > whole[..., 3].sum()


def test_an_error_stays_until_it_is_mended(lit, scene):
    settled()
    red = scene.mps.rig.lights[0].object
    red.hide_render = True
    settled()
    assert "red light is hidden from renders" in light_preview().error
    red.hide_render = False
    settled()
    assert light_preview().error == ""
    lit.hide_render = True
    settled()
    assert "no object of the photo has a surface" in light_preview().error
    lit.hide_render = False
    settled()
    assert light_preview().error == ""


def again(scene):
    bpy.ops.mps.light_preview()


def rig_removed(scene):
    bpy.ops.mps.remove_rig()
    tick()


def scene_removed(scene):
    bpy.data.scenes.new("Other")
    bpy.data.scenes.remove(scene)
    tick()


def file_opened(scene):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize("how", [again, rig_removed, scene_removed, file_opened])
def test_it_ends_and_leaves_nothing(lit, scene, how, running):
    images = set(bpy.data.images.keys())
    if not running:
        settled()
    while running and light_preview().process is None:
        tick()
    preview, folder = light_preview(), light_preview().folder
    assert folder.is_dir()
    how(scene)
    assert light_preview() is None and not Path(folder).exists()
    assert preview.process is None or not preview.process.running()
    assert set(bpy.data.images.keys()) == images
    assert tick() is None  # the timer ends
