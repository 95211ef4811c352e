"""Many views: photos rendered from all around, their cameras of this scene or from COLMAP, one texture."""

import math

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest
from mathutils import Matrix, Vector

from blender_addon.bake.many_views import _with_photos
from blender_addon.panels.views import MPS_PT_views
from mpsnet_core import read_albedo, read_image, write_image
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.scene.normal_encoding import read_vectors

from .rendering import shader_of
from .test_steps import Kind, stands

SIZE = 96


def texel_normals(size: int) -> np.ndarray:
    """(size, size, 3) the unit sphere's normal in each texel of Blender's UV sphere: its UVs are angles."""
    u = (np.arange(size) + 0.5) / size
    v = 1 - u
    # Blender's UV sphere begins its UVs at -x and runs counter-clockwise seen from above.
    turn, rise = 2 * np.pi * u + np.pi, np.pi * (v - 0.5)
    turn, rise = np.meshgrid(turn, rise)
    return np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1)


@pytest.fixture
def around(sphere, scene, tmp_path):
    """Photos of the sphere from four sides under lights that go with the camera, behind a camera each."""
    scene.mps.photo.width = scene.mps.photo.height = SIZE
    scene.mps.photo.samples = 4
    bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=60, slant=25)
    target = scene.mps.rig.target
    front = target.matrix_world.copy()
    for number in range(4):
        target.matrix_world = Matrix.Rotation(math.pi / 2 * number, 4, "Z") @ front
        bpy.context.view_layer.update()
        bpy.ops.mps.render_photo(output=str(tmp_path / f"side{number}.exr"))
        camera = bpy.data.objects.new(f"Side {number}", scene.mps.rig.camera.data.copy())
        camera.matrix_world = scene.mps.rig.camera.matrix_world
        scene.collection.objects.link(camera)
        behind = camera.data.background_images.new()
        behind.image = bpy.data.images.load(str(tmp_path / f"side{number}.exr"))
    scene.mps.bake.size, scene.mps.bake.space = 128, "OBJECT"
    scene.mps.bake.output = str(tmp_path / "texture.png")
    scene.mps.estimate.model = "LAMBERTIAN"
    return sphere


def error(path) -> float:
    """Mean error of the texture in the band around the equator, which all sides see."""
    baked = normalised(read_vectors(path)[0])
    band = slice(40, 88)
    return float(angular_error(baked, texel_normals(128))[band].mean())


def test_cameras_with_background_images_become_one_texture(around, scene, tmp_path):
    bpy.ops.mps.bake_views(level=False)
    assert error(tmp_path / "texture.png") < 1.5
    assert scene.mps.bake.image is not None
    page = (tmp_path / "texture_report.html").read_text()
    assert all(f"Side_{number}" in page for number in range(4))
    nodes = around.data.materials[0].node_tree.nodes
    assert nodes["MPS Texture"].image == scene.mps.bake.image
    assert stands(MPS_PT_views) == (Kind.DONE, "")
    camera = bpy.data.objects["Side 0"]
    camera.location.x += 0.1
    bpy.context.view_layer.update()
    assert stands(MPS_PT_views) == (Kind.OUT_OF_DATE, "Changed since: Cameras' places")
    camera.location.x -= 0.1
    camera.data.shift_x = 0.1
    bpy.context.view_layer.update()
    assert stands(MPS_PT_views) == (Kind.OUT_OF_DATE, "Changed since: Cameras' places")
    camera.data.shift_x = 0
    bpy.ops.mps.render_photo(output=str(tmp_path / "side3.exr"), samples=1)
    assert stands(MPS_PT_views) == (Kind.OUT_OF_DATE, "Changed since: Background images")
    scene.mps.bake.mark_asset = "MATERIAL"  # which is not what the texture is made of
    assert stands(MPS_PT_views)[1] == "Changed since: Background images"
    scene.mps.views.lights_in = "WORLD"
    assert stands(MPS_PT_views)[1] == "Changed since: Background images, Lights"
    scene.mps.views.property_unset("lights_in")
    # The sphere's own normals are the truth here, so levelling can only make it better.
    bpy.ops.mps.bake_views(level=True, write_report=False)
    assert error(tmp_path / "texture.png") < 1.0


def test_photos_of_turned_cameras_are_seen_as_blender_shows_them(around, scene, tmp_path):
    """Portraits, which Blender shows lying on their side, each behind a camera that lies as well."""
    for number in range(4):
        photo, camera = read_image(tmp_path / f"side{number}.exr"), bpy.data.objects[f"Side {number}"]
        upright = np.dstack([photo.pixels, photo.alpha])[:, 16:80]
        spec = oiio.ImageSpec(SIZE, 64, 4, oiio.FLOAT)
        spec.attribute("Orientation", 6)  # to be turned a quarter clockwise
        stored = oiio.ImageBuf(spec)
        stored.set_pixels(oiio.ROI(), np.ascontiguousarray(np.rot90(upright)))
        assert stored.write(str(tmp_path / f"side{number}.tif"))
        camera.matrix_world = camera.matrix_world @ Matrix.Rotation(-math.pi / 2, 4, "Z")
        camera.data.background_images[0].image = bpy.data.images.load(str(tmp_path / f"side{number}.tif"))
    bpy.ops.mps.bake_views(level=False)
    assert error(tmp_path / "texture.png") < 1.5


def test_white_photos_give_the_material_its_colour(around, scene, tmp_path):
    """The white sphere as if it were painted, and each view exposed otherwise."""
    colour = np.array([0.6, 0.3, 0.15])
    (tmp_path / "white").mkdir()
    for number, exposure in enumerate((1, 0.4, 2, 0.7)):
        photo = read_image(tmp_path / f"side{number}.exr").pixels
        white = photo.sum(axis=-1, keepdims=True) * colour * exposure
        write_image(tmp_path / "white" / f"side{number}_white.exr", white)
    bpy.ops.mps.bake_views(level=False, white=str(tmp_path / "white"))
    tree = around.data.materials[0].node_tree
    shader = shader_of(tree)
    shown = shader.inputs["Base Color"].links[0].from_node.image
    assert shown.colorspace_settings.name == "sRGB"
    assert shader.inputs["Normal"].links[0].from_node == tree.nodes["MPS Normal"]
    band = read_albedo(shown.filepath)[40:88]
    assert np.abs(band / band.sum(axis=-1, keepdims=True) - colour / colour.sum()).max() < 0.01
    assert np.quantile(np.abs(band / np.median(band, axis=(0, 1)) - 1), 0.9) < 0.1


def test_a_photo_behind_two_cameras_is_one_view_of_the_one_that_took_it(around, scene):
    cameras = [bpy.data.objects[f"Side {number}"] for number in range(4)]
    image, other = (camera.data.background_images[0].image for camera in cameras[:2])
    cameras[1].data.background_images[0].image = image
    assert [obj for obj, _ in _with_photos(scene)] == [cameras[0], cameras[2], cameras[3]]
    image["mpsnet_made_by"], image.mps.camera = "open_photo", cameras[1]
    assert [obj for obj, _ in _with_photos(scene)] == cameras[1:]
    cameras[1].data.background_images[0].image = other
    assert [obj for obj, _ in _with_photos(scene)] == cameras


def test_lights_that_stand_still_are_those_of_the_scene(around, scene, tmp_path):
    """One camera is the rig's own: in the world or with the camera, its lights are the same."""
    for number in range(3):
        bpy.data.objects.remove(bpy.data.objects[f"Side {number}"])
    textures = []
    for lights in ("CAMERA", "WORLD"):
        bpy.ops.mps.bake_views(level=False, write_report=False, lights_in=lights)
        textures.append(normalised(read_vectors(tmp_path / "texture.png")[0]))
    assert angular_error(*textures).max() < 0.1


@pytest.mark.parametrize("axes", ["AS_IS", "Y_UP"])
def test_cameras_from_colmap_meet_the_mesh_as_it_was_imported(around, scene, tmp_path, axes):
    """The same cameras as COLMAP would have them, in a world that is Blender's, or has y up."""
    to_file = Matrix.Rotation(-math.pi / 2, 4, "X") if axes == "Y_UP" else Matrix.Identity(4)
    (tmp_path / "colmap").mkdir()
    cameras, images = [], []
    for number in range(4):
        obj = bpy.data.objects[f"Side {number}"]
        pose = (to_file @ obj.matrix_world @ Matrix.Diagonal(Vector((1, -1, -1, 1)))).inverted()
        turn, move = pose.to_quaternion(), pose.translation
        focal = SIZE * obj.data.lens / obj.data.sensor_width
        cameras.append(f"{number + 1} PINHOLE {SIZE} {SIZE} {focal} {focal} {SIZE / 2} {SIZE / 2}")
        images += [" ".join(map(str, [number + 1, *turn, *move, number + 1, f"side{number}.exr"])), ""]
        bpy.data.objects.remove(obj)
    (tmp_path / "colmap" / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (tmp_path / "colmap" / "images.txt").write_text("\n".join(images) + "\n")
    bpy.ops.mps.bake_views(
        cameras=str(tmp_path / "colmap"), photos=str(tmp_path), axes=axes, level=False, write_report=False
    )
    assert error(tmp_path / "texture.png") < 1.5


def test_what_is_missing_is_reported(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    with pytest.raises(RuntimeError, match="no camera of this scene has a background image"):
        bpy.ops.mps.bake_views()
    with pytest.raises(RuntimeError, match="where are the photos of these cameras"):
        bpy.ops.mps.bake_views(cameras=str(tmp_path))
    with pytest.raises(RuntimeError, match="COLMAP"):
        bpy.ops.mps.bake_views(cameras=str(tmp_path), photos=str(tmp_path))


def test_cameras_whose_names_become_one_in_a_files_name_are_views_of_their_own(around, scene, tmp_path):
    for number, name in ((0, "Cam 1"), (1, "Cam_1"), (2, "cam.1")):
        bpy.data.objects[f"Side {number}"].name = name
    bpy.ops.mps.bake_views(level=False, keep=str(tmp_path / "kept"))
    assert error(tmp_path / "texture.png") < 1.5
    kept = sorted(file.name for file in (tmp_path / "kept").glob("*_normals.png"))
    assert kept == ["Cam_1_1_normals.png", "Cam_1_2_normals.png", "Side_3_normals.png", "cam_1_3_normals.png"]
