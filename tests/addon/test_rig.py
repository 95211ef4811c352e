"""The rig in Blender and as the core's data types."""

import math

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Matrix, Vector

from blender_addon.rig.rig import light_rig
from blender_addon.scene.camera import scene_camera
from blender_addon.scene.surfaces import bounding_sphere

EXACT = 1e-4  # degrees


def angles_apart(a, b):
    return np.abs((np.asarray(a) - np.asarray(b) + 180) % 360 - 180)


@pytest.mark.parametrize("light_type", ["SUN", "AREA"])
@pytest.mark.parametrize("projection", ["ORTHOGRAPHIC", "PERSPECTIVE"])
@pytest.mark.parametrize("view", ["FRONT", "LEFT", "TOP"])
def test_lights_stand_where_they_were_asked_to(sphere, scene, light_type, projection, view):
    bpy.ops.mps.add_rig(slant=40, tilt=10, light_type=light_type, projection=projection, view=view)
    rig = light_rig(scene)
    assert angles_apart(rig.slants, 40).max() < EXACT
    assert angles_apart(rig.tilts, [10, 130, 250]).max() < EXACT
    assert np.allclose(rig.mixing, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("light_type", ["SUN", "AREA"])
def test_a_light_moved_by_hand_is_known(sphere, scene, light_type):
    bpy.ops.mps.add_rig(light_type=light_type)
    green = scene.mps.rig.lights[1].object
    place = Vector((3.0, -4.0, 1.0))
    bpy.context.view_layer.update()
    green.matrix_world = Matrix.Translation(place)
    # The front camera's x, y and z are the world's x, z and -y.
    x, y, z = place.x, place.z, -place.y
    rig = light_rig(scene)
    assert rig.slants[1] == pytest.approx(math.degrees(math.atan2(math.hypot(x, y), z)), abs=EXACT)
    assert rig.tilts[1] == pytest.approx(math.degrees(math.atan2(y, x)), abs=EXACT)
    assert angles_apart(rig.slants[[0, 2]], 30).max() < EXACT


def test_a_turned_sun_without_its_aim_is_known(sphere, scene):
    bpy.ops.mps.add_rig()
    red = scene.mps.rig.lights[0].object
    red.constraints.clear()
    red.parent = None
    red.rotation_euler = (math.radians(90 - 20), 0, 0)  # 90° shines along +Y, away from the front camera
    rig = light_rig(scene)
    assert rig.slants[0] == pytest.approx(20, abs=EXACT)
    assert rig.tilts[0] == pytest.approx(90, abs=EXACT)


def test_the_rig_keeps_its_angles_under_a_turned_and_scaled_parent(sphere, scene):
    bpy.ops.mps.add_rig(slant=35)
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    scene.mps.rig.target.parent = parent
    parent.matrix_world = Matrix.LocRotScale(Vector((1, 2, 3)), Matrix.Rotation(0.7, 3, "Y"), Vector((3, 3, 3)))
    rig = light_rig(scene)
    assert angles_apart(rig.slants, 35).max() < EXACT
    assert scene.mps.rig.camera.matrix_world.translation.length > 10


def test_moving_the_target_moves_everything(sphere, scene):
    bpy.ops.mps.add_rig()
    parts = [scene.mps.rig.camera, *(light.object for light in scene.mps.rig.lights)]
    before = [part.matrix_world.translation.copy() for part in parts]
    scene.mps.rig.target.location.x += 5
    bpy.context.view_layer.update()
    for part, place in zip(parts, before, strict=True):
        assert (part.matrix_world.translation - place - Vector((5, 0, 0))).length < 1e-5


def test_a_rig_can_be_added_or_replaced_where_something_besides_it_is_selected(sphere, scene):
    def can():
        return bpy.ops.mps.add_rig.poll(), bpy.ops.mps.add_rig_ring.poll()

    for _ in range(2):
        sphere.select_set(False)
        assert can() == (False, False)
        for light in scene.mps.rig.lights:
            light.object.select_set(True)
        assert can() == (False, False)
        sphere.select_set(True)
        assert can() == (True, True)
        bpy.ops.mps.add_rig()


def test_removing_takes_the_rigs_own_collection_alone(sphere, scene):
    bpy.ops.mps.add_rig()
    scene.mps.rig.collection.name = "Lamps"
    mine = bpy.data.collections.new("MPS Rig of mine")
    scene.collection.children.link(mine)
    mine.objects.link(scene.mps.rig.camera)
    bpy.ops.mps.remove_rig()
    assert list(bpy.data.collections) == [mine]


def test_lights_of_unlike_colour_and_strength_mix(sphere, scene):
    bpy.ops.mps.add_rig()
    red, green, _ = (light.object.data for light in scene.mps.rig.lights)
    red.color = (1.0, 0.25, 0.0)
    green.energy /= 2
    expected = np.array([[1, 0, 0], [0.25, 0.5, 0], [0, 0, 1]])
    assert np.allclose(light_rig(scene).mixing, expected, atol=1e-6)


def test_the_sphere_around_objects_counts_modifiers_and_instances(scene):
    bpy.ops.mesh.primitive_cube_add(size=2, location=(10, 0, 0))
    cube = bpy.context.object
    array = cube.modifiers.new("Array", "ARRAY")
    array.count, array.relative_offset_displace = 3, (1, 0, 0)
    centre, radius = bounding_sphere(bpy.context.evaluated_depsgraph_get(), [cube])
    assert np.allclose(centre, (12, 0, 0), atol=1e-6)
    assert radius == pytest.approx(math.sqrt(9 + 1 + 1), abs=1e-6)

    collection = bpy.data.collections.new("Instanced")
    collection.objects.link(cube)
    scene.collection.objects.unlink(cube)
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    instance.location.z = 7
    scene.collection.objects.link(instance)
    centre, _ = bounding_sphere(bpy.context.evaluated_depsgraph_get(), [instance])
    assert np.allclose(centre, (12, 0, 7), atol=1e-6)


@pytest.mark.parametrize("projection", ["ORTHOGRAPHIC", "PERSPECTIVE"])
@pytest.mark.parametrize("size", [(640, 640), (2000, 500), (500, 2000)])
@pytest.mark.parametrize(
    ("shape", "turned"),
    [
        ("sphere", (0, 0, 0)),
        ("box", (0, 0, 0)),
        ("box", (0, 0, math.pi / 2)),  # its end faces the camera
        ("box", (0.5, 0.8, 0.3)),
    ],
)
def test_what_the_camera_sees_fills_the_photo_but_for_its_margin(scene, projection, size, shape, turned):
    if shape == "sphere":
        bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, location=(3, -2, 5))
    else:
        bpy.ops.mesh.primitive_cube_add(size=2, location=(3, -2, 5), rotation=turned, scale=(3, 0.5, 0.4))
    obj = bpy.context.object
    scene.mps.photo.width, scene.mps.photo.height = size
    scene.render.resolution_x, scene.render.resolution_y = size
    bpy.ops.mps.add_rig(projection=projection)
    camera = scene.mps.rig.camera
    # Blender's own words for where a point is in the picture: 0 to 1 along both sides.
    seen = np.array([world_to_camera_view(scene, camera, obj.matrix_world @ v.co)[:2] for v in obj.data.vertices])
    tighter = int(np.argmax(np.ptp(seen, axis=0)))
    low, high = seen[:, tighter].min(), seen[:, tighter].max()
    assert high - low == pytest.approx(0.9, abs=0.02)
    assert (low, high) == pytest.approx((0.05, 0.95), abs=0.01)
    assert seen.mean(axis=0) == pytest.approx((0.5, 0.5), abs=0.1)


@pytest.mark.parametrize("kind", ["ORTHO", "PERSP"])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize(
    ("width", "height", "percentage", "aspect"),
    [(192, 108, 100, (1, 1)), (60, 80, 50, (1, 1)), (72, 58, 100, (1.5, 1)), (64, 64, 100, (1, 2))],
)
def test_the_camera_projects_as_blenders(scene, kind, fit, width, height, percentage, aspect):
    data = bpy.data.cameras.new("Camera")
    camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(camera)
    data.type, data.sensor_fit = kind, fit
    data.lens, data.ortho_scale, data.sensor_width, data.sensor_height = 40, 5, 30, 20
    data.shift_x, data.shift_y = 0.13, -0.21
    camera.matrix_world = Matrix.LocRotScale(Vector((1, -8, 2)), Matrix.Rotation(1.4, 3, "X"), Vector((2, 2, 2)))
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, percentage
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    bpy.context.view_layer.update()

    ours = scene_camera(camera, scene)
    for point in np.random.default_rng(1).uniform(-2, 2, (20, 3)):
        x, y, w = ours.projection_rows() @ [*point, 1]
        theirs = world_to_camera_view(scene, camera, Vector(point))
        assert x / w == pytest.approx(theirs.x * ours.width, abs=1e-4)
        assert y / w == pytest.approx((1 - theirs.y) * ours.height, abs=1e-4)
        assert ours.depth_row() @ [*point, 1] == pytest.approx(theirs.z, abs=1e-5)
