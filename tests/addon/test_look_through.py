"""Look Through: the viewport sees what the photo's camera sees, and what it saw before."""

import bpy
import pytest

from blender_addon.photo.look_through import watch


@pytest.fixture
def viewport(scene):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    region = next(region for region in area.regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window, area=area, region=region):
        yield area.spaces.active


def test_one_press_looks_through_the_photos_camera_and_the_next_one_leaves_it(viewport):
    scene, view = bpy.context.scene, viewport.region_3d
    with pytest.raises(RuntimeError, match="Add a rig first"):
        bpy.ops.mps.look_through()
    bpy.ops.mps.add_rig(view="LEFT")
    own = scene.camera
    assert own != scene.mps.rig.camera
    bpy.ops.mps.look_through()
    assert (view.view_perspective, viewport.camera) == ("CAMERA", scene.mps.rig.camera)
    assert scene.camera == own  # renders are taken with it as ever
    bpy.ops.mps.look_through()
    assert view.view_perspective == "PERSP" and not viewport.use_local_camera


def test_the_frame_is_the_photos_until_the_view_is_left(viewport):
    """By whatever way: the button, or the mouse that turns the view."""
    scene = bpy.context.scene
    render = scene.render
    render.resolution_x, render.resolution_y, render.pixel_aspect_x = 1920, 1080, 2
    bpy.ops.mps.add_rig()
    scene.mps.photo.width, scene.mps.photo.height = 300, 200

    def frame():
        return render.resolution_x, render.resolution_y, render.pixel_aspect_x

    for leave in (bpy.ops.mps.look_through, bpy.ops.view3d.view_camera):
        bpy.ops.mps.look_through()
        assert frame() == (300, 200, 1)
        assert watch() is not None and frame() == (300, 200, 1)
        leave()
        assert watch() is None and frame() == (1920, 1080, 2)

    bpy.ops.mps.look_through()
    render.resolution_x = 640  # what is changed meanwhile stays
    bpy.ops.mps.look_through()
    assert frame() == (640, 200, 1)
    scene["mpsnet_frame_before"] = "nothing of ours"
    assert watch() is None and frame() == (640, 200, 1)


def test_of_a_photo_that_was_taken_with_a_real_camera_it_must_be_known(viewport, tmp_path):
    scene = bpy.context.scene
    bpy.ops.mps.add_rig()
    scene.render.image_settings.file_format = "PNG"
    image = bpy.data.images.new("Real", 8, 8)
    image.save(filepath=str(tmp_path / "real.png"))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "real.png"))
    with pytest.raises(RuntimeError, match="Align Photo"):
        bpy.ops.mps.look_through()
    scene.mps.photo.image.mps.camera = bpy.data.objects["Camera"]
    bpy.ops.mps.look_through()
    assert viewport.camera == bpy.data.objects["Camera"]
    assert (scene.render.resolution_x, scene.render.resolution_y) == (8, 8)
