"""Before / After and the photos dropped for Scan: what they compute, against Blender's own; tests/blender sees them."""

import shutil

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Matrix, Vector

from blender_addon.bake.before_after import View, corners_of, in_photo, room, textures_of
from blender_addon.image_records import remember
from blender_addon.photo.places import seen_at
from blender_addon.scene.camera import scene_camera
from blender_addon.scene.mesh_file import begin_mesh
from blender_addon.start.scan import photo_and_white
from mpsnet_core.scene.mesh import read_mesh

from .rendering import array_of, save_png


@pytest.fixture
def turned(scene):
    """A turned and moved sphere of triangles."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    sphere = bpy.context.object
    bpy.ops.object.shade_smooth()
    sphere.matrix_world = Matrix.LocRotScale((3, -1, 2), Euler((0.3, -0.2, 0.9)), (1.5, 1.5, 1.5))
    bpy.context.view_layer.update()
    return sphere


def corners(obj, folder, **stored):
    texture = bpy.data.images.new("texture", 4, 4)
    for what, text in stored.items():
        remember(texture, what, text)
    begin_mesh(folder / "mesh.npz", obj, bpy.context.evaluated_depsgraph_get(), "").whole()
    return corners_of(read_mesh(folder / "mesh.npz"), texture)


def test_a_tangent_space_texture_is_shown_along_blenders_own_tangents(turned, tmp_path):
    found = corners(turned, tmp_path, space="TANGENT", convention="OPENGL")
    mesh = turned.data
    mesh.calc_tangents()
    to_world = np.array(turned.matrix_world.to_3x3().normalized()).T
    for axis, name in (("first", "tangent"), ("second", "bitangent"), ("third", "normal")):
        np.testing.assert_allclose(found[axis], array_of(mesh.loops, name, 3) @ to_world, atol=2e-3)
    places = array_of(mesh.vertices, "co", 3)[array_of(mesh.loops, "vertex_index", 1, np.int32)[:, 0]]
    expected = [turned.matrix_world @ Vector(place) for place in places[:50]]
    np.testing.assert_allclose(found["place"][:50], expected, atol=1e-5)
    down = corners(turned, tmp_path, space="TANGENT", convention="DIRECTX")
    np.testing.assert_allclose(down["second"], -found["second"])


def test_an_object_space_texture_is_shown_along_the_objects_axes(turned, tmp_path):
    found = corners(turned, tmp_path, space="OBJECT", convention="OPENGL")
    axes = np.array(turned.matrix_world.to_3x3().normalized())
    for number, name in enumerate(("first", "second", "third")):
        shown = found[name] / np.linalg.norm(found[name], axis=1, keepdims=True)
        np.testing.assert_allclose(shown, np.broadcast_to(axes[:, number], shown.shape), atol=1e-5)


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_the_photo_is_where_blenders_camera_sees_the_mesh(scene, kind):
    data = bpy.data.cameras.new("camera")
    data.type, data.lens, data.ortho_scale, data.shift_x = kind, 60, 3, 0.1
    camera = bpy.data.objects.new("camera", data)
    scene.collection.objects.link(camera)
    camera.matrix_world = Matrix.LocRotScale((1, -6, 2), Euler((1.3, 0.1, 0.2)), None)
    scene.render.resolution_x, scene.render.resolution_y = 400, 300
    bpy.context.view_layer.update()
    places = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    found = in_photo(scene_camera(camera, scene), places, np.tile([0, -1, 0.2], (20, 1)))
    expected = np.array([world_to_camera_view(scene, camera, Vector(place)) for place in places])
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-5)
    assert (found[:, 2] > 0).all()
    assert (in_photo(scene_camera(camera, scene), places, np.tile([0, 1, -0.2], (20, 1)))[:, 2] < 0).all()


@pytest.mark.parametrize(("across", "size"), [(0.0, 1.0), (-4.0, 1.5), (3.0, 0.5), (0.0, 3.3)])
def test_the_object_is_shown_in_the_middle_of_what_bars_and_pictures_leave(turned, across, size):
    """Wherever the viewport shows it; smaller, if it is larger than that."""
    area = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    view, window = area.spaces.active.region_3d, next(one for one in area.regions if one.type == "WINDOW")
    eye = view.view_matrix.inverted()
    turned.matrix_world = Matrix.Translation(eye @ Vector((across, 0, -18))) @ Matrix.Scale(size, 4)
    bpy.context.view_layer.update()

    ends = [turned.matrix_world @ Vector(corner) for corner in turned.bound_box]

    def places(moved):
        seen = moved @ view.perspective_matrix
        return np.array([seen_at(end, seen, (window.width, window.height)) for end in ends])

    left, low, right, high = room(area)
    shown = View.of(area, ends)
    found, before = places(shown.in_room(area)), places(Matrix())
    ends = found.min(axis=0), found.max(axis=0)
    np.testing.assert_allclose((ends[0] + ends[1]) / 2, ((left + right) / 2, (low + high) / 2), atol=1)
    assert (ends[0] > (left, low)).all() and (ends[1] < (right, high)).all()
    assert (np.ptp(before, axis=0)[1] > high - low) == (shown.scale(area) < 0.9)
    start, middle = shown.dividers(area)
    assert left + middle * (right - left) == pytest.approx((ends[0] + ends[1])[0] / 2, abs=1)
    assert left + start * (right - left) == pytest.approx((3 * ends[0] + ends[1])[0] / 4, abs=1)


def test_it_asks_for_a_texture_first(turned):
    assert textures_of(turned) == textures_of(None) == {}
    with pytest.raises(RuntimeError, match="Bake a texture onto the target first"):
        bpy.ops.mps.before_after()


# --- dropped photos ---------------------------------------------------------------------------------------------------


@pytest.fixture
def pictures(scene, tmp_path):
    """A painted sphere under three coloured lights, and under white light with another white balance."""
    y, x = np.mgrid[1:-1:64j, -1:1:64j]
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    paint = np.where((x * y > 0)[..., None], (0.8, 0.5, 0.3), (0.2, 0.3, 0.7)) * (x**2 + y**2 < 1)[..., None]
    turns = np.radians([90, 210, 330])
    lights = np.stack([0.5 * np.cos(turns), 0.5 * np.sin(turns), np.full(3, 0.87)], axis=-1)
    lit = np.maximum(normals @ lights.T, 0)
    white = lit.mean(axis=-1, keepdims=True) * (1, 0.8, 0.5)
    return save_png(tmp_path / "a.png", paint * lit), save_png(tmp_path / "b.png", paint * white)


def test_the_white_photo_is_known_by_its_colours_in_whatever_order_they_are_dropped(pictures):
    photo, white = pictures
    before = set(bpy.data.images)
    assert photo_and_white([photo, white]) == photo_and_white([white, photo]) == (str(photo), str(white))
    assert photo_and_white([photo]) == (str(photo), "")
    assert set(bpy.data.images) == before


def test_dropped_pictures_are_the_photo_and_its_white_photo(scene, pictures):
    photo, white = pictures
    with pytest.raises(RuntimeError, match="select the mesh object"):
        bpy.ops.mps.scan(directory=str(photo.parent), files=[{"name": white.name}, {"name": photo.name}])
    assert scene.mps.photo.image.filepath == str(photo) and scene.mps.estimate.white == str(white)


def test_pictures_that_are_no_photo_with_its_white_photo_are_refused(pictures):
    photo, white = pictures
    bpy.ops.mesh.primitive_uv_sphere_add()

    def drop(*files):
        bpy.ops.mps.scan(directory=str(photo.parent), files=[{"name": file.name} for file in files])

    with pytest.raises(RuntimeError, match="4 pictures"):
        drop(photo, white, white, white)
    with pytest.raises(RuntimeError, match="equally colourful"):
        drop(photo, shutil.copy(photo, photo.with_name("c.png")))
