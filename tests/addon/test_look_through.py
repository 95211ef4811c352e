"""Look Through: the viewport sees what the photo's camera sees, and what it saw before."""

import bpy
import pytest


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
