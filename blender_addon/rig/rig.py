"""The rig: three coloured lights and a camera around an object, and what they are as the core's nouns."""

import math
from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.scene.rig import LightRig, direction_from_angles, near_rig

from ..operators import ReportingOperator
from ..scene.objects import view_layer
from ..scene.surfaces import sphere_around, surface_points
from ..settings.declared import take_given
from ..settings.rig import RigSettings

COLOURS = {"Red": (1.0, 0.0, 0.0), "Green": (0.0, 1.0, 0.0), "Blue": (0.0, 0.0, 1.0)}
COLLECTION = "MPS Rig"
SENSOR_WIDTH = 36.0
# How the brightness of lights with a place falls off their axis: a disc is seen smaller from the side.
_LOBES = {"AREA": 1.0, "POINT": 0.0, "SPOT": 0.0}
# How near a perspective camera comes to a tip that points at it, in radii of the object.
_NEAREST = 0.1

# Columns are the camera's x, y and z axes in the world.
_VIEWS = {
    "FRONT": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "BACK": ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "LEFT": ((0, -1, 0), (0, 0, 1), (-1, 0, 0)),
    "RIGHT": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "TOP": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "BOTTOM": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
}


class MPS_OT_add_rig(ReportingOperator, RigSettings, bpy.types.Operator):
    """Add three coloured lights and a camera around the selected objects, in place of an earlier rig"""

    bl_idname = "mps.add_rig"
    bl_label = "Add Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        active = context.view_layer.objects.active
        if active is not None and active.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        return True

    def act(self, context: Any) -> None:
        take_given(self, RigSettings, context.scene.mps.rig)
        add_rig(context)


class MPS_OT_remove_rig(bpy.types.Operator):
    """Remove the rig's lights, camera and target"""

    bl_idname = "mps.remove_rig"
    bl_label = "Remove Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.scene.mps.rig.target is None:
            cls.poll_message_set("There is no rig in this scene")
            return False
        return True

    def execute(self, context: Any) -> set[Any]:
        remove_rig(context.scene)
        return {"FINISHED"}


def add_rig(context: Any) -> None:
    """Build the rig around the selected objects with the scene's settings, in place of an earlier one.

    Raises InputError where nothing with a surface is selected.
    """
    scene, settings = context.scene, context.scene.mps.rig
    old = set(rig_objects(scene))
    selected = [obj for obj in context.view_layer.objects.selected if obj not in old]
    if not selected:
        raise InputError("nothing is selected; select the object that the rig shall stand around")
    orientation = _orientation(context, settings.view)
    points = surface_points(context.evaluated_depsgraph_get(), selected)
    centre, radius = sphere_around(points, orientation)
    seen = (points - np.array(centre)) @ np.array(orientation)
    remove_rig(scene)

    settings.collection = collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    target = bpy.data.objects.new("MPS Target", None)
    target.empty_display_size = radius / 4
    target.matrix_world = Matrix.Translation(centre) @ orientation.to_4x4()
    collection.objects.link(target)
    settings.target = target
    meshes = [obj for obj in selected if obj.type == "MESH"]
    scene.mps.estimate.surface = meshes[0] if len(meshes) == 1 else None
    settings.camera = _add_camera(scene, seen, radius)
    reach = settings.distance * radius
    directions = direction_from_angles([settings.slant] * 3, settings.tilt + np.array([0.0, 120.0, 240.0]))
    for name, direction in zip(COLOURS, directions, strict=True):
        settings.lights.add().object = _add_light(settings, name, Vector(direction) * reach)
    for obj in (settings.camera, *(light.object for light in settings.lights)):
        obj.parent = target
        collection.objects.link(obj)
    if scene.camera is None:
        scene.camera = settings.camera
    context.view_layer.update()


def remove_rig(scene: Any) -> None:
    """Remove the rig's objects, and its collection unless something else lies in it."""
    settings = scene.mps.rig
    for obj in list(rig_objects(scene)):
        data = obj.data
        bpy.data.objects.remove(obj)
        if isinstance(data, bpy.types.Camera) and not data.users:
            bpy.data.cameras.remove(data)
        elif isinstance(data, bpy.types.Light) and not data.users:
            bpy.data.lights.remove(data)
    collection = settings.collection
    if collection is not None and not collection.objects and not collection.children:
        bpy.data.collections.remove(collection)
    settings.collection = None
    settings.lights.clear()


def rig_objects(scene: Any) -> Iterable[Any]:
    """The rig's own objects that still exist in the file: lights, camera, target.

    A camera that was there before the rig and only takes its photos is not one of them.
    """
    settings = scene.mps.rig
    every = [light.object for light in settings.lights] + [settings.target]
    around = settings.collection.objects if settings.collection is not None else ()
    cameras = [obj for obj in around if obj.type == "CAMERA" and obj.parent == settings.target]
    return [obj for obj in (*every, *cameras) if obj is not None]


def _orientation(context: Any, view: str) -> Matrix:
    if view != "VIEWPORT":
        return Matrix(_VIEWS[view]).transposed()
    region = getattr(context, "region_data", None)
    if region is None:
        raise InputError('view "VIEWPORT" needs a 3D viewport to take it from; choose "FRONT" or another side')
    return region.view_rotation.to_matrix()


def _add_camera(scene: Any, seen: NDArray[np.float64], radius: float) -> Any:
    """A camera that looks along the target's -z axis, from where what it sees fits the photo with its margin.

    seen: (N, 3) points of the surface in the target's axes. radius: how far they reach from the target.
    """
    settings, photo = scene.mps.rig, scene.mps.photo
    data = bpy.data.cameras.new("MPS Camera")
    data.sensor_fit, data.sensor_width, data.lens = "AUTO", SENSOR_WIDTH, settings.focal_length
    # (2,) the part of the picture that the object may fill, in units of its longer side.
    fill = np.array([photo.width, photo.height]) / max(photo.width, photo.height) / (1 + settings.margin)
    if settings.projection == "ORTHOGRAPHIC":
        data.type = "ORTHO"
        data.ortho_scale = float((np.ptp(seen[:, :2], axis=0) / fill).max())
        place = np.array([0, 0, max(settings.distance, 2.0) * radius])
    else:
        data.type = "PERSP"
        place = _where_it_fits(seen, fill * SENSOR_WIDTH / 2 / settings.focal_length, radius)
    nearest, away = place[2] - seen[:, 2].max(), place[2]
    # Room for an object that is moved within the rig, without the loss of depth that 0.1 mm to 1 km would cost.
    data.clip_start, data.clip_end = nearest / 100, (away + radius) * 10
    camera = bpy.data.objects.new("MPS Camera", data)
    camera.location = place
    return camera


def _where_it_fits(seen: NDArray[np.float64], slopes: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """(3,) the nearest place from which points (N, 3) lie within a view along -z whose sides have slopes (2,)."""
    # Each side of the view is a plane that moves with the camera; its outermost point bounds where it may be.
    reach = seen[:, 2:] * slopes
    high, low = (seen[:, :2] + reach).max(axis=0), (reach - seen[:, :2]).max(axis=0)
    away = ((high + low) / (2 * slopes)).max()
    return np.array([*(high - low) / 2, max(away, seen[:, 2].max() + _NEAREST * radius)])


def _add_light(settings: Any, name: str, location: Vector) -> Any:
    """A light of pure colour at `location` in the target's axes, which turns to the target wherever it is moved."""
    reach, angle = location.length, math.radians(settings.light_size)
    data = bpy.data.lights.new(f"MPS {name}", settings.light_type)
    data.color = COLOURS[name]
    if settings.light_type == "SUN":
        data.angle = angle
        data.energy = settings.strength * math.pi
    else:
        data.shape = "DISK"
        data.size = max(2 * reach * math.tan(angle / 2), 1e-4 * reach)
        data.energy = settings.strength * _area_power(reach)
    light = bpy.data.objects.new(f"MPS {name}", data)
    light.location = location
    light.rotation_euler = location.to_track_quat("Z", "Y").to_euler()
    aim = light.constraints.new("DAMPED_TRACK")
    aim.name, aim.target, aim.track_axis = "MPS Aim", settings.target, "TRACK_NEGATIVE_Z"
    return light


def _area_power(distance: float) -> float:
    """Watts with which an area light at `distance` lights a surface facing it as a sun of strength π does."""
    return (math.pi * distance) ** 2


def light_rig(scene: Any) -> LightRig:
    """The rig as its objects stand now, in the camera's axes.

    A sun shines along its own axis wherever it stands; any other light shines from its place towards the target. Where
    all three are of one such kind they are near lights, which differ from pixel to pixel. The mixing matrix follows
    from the lights' colours and their brightness at the target.

    Raises InputError where a part of the rig is missing, or no normal can be told from how the lights stand.
    """
    view_layer(scene).update()
    return drawn_rig(scene)


def drawn_rig(scene: Any) -> LightRig:
    """:func:`light_rig` as Blender last evaluated the scene, for panels, which must not evaluate it."""
    camera, target, lights = rig_parts(scene)
    to_camera = np.array(camera.matrix_world.normalized().to_3x3()).T
    centre = target.matrix_world.translation
    directions = np.array([_direction(light, centre) for light in lights])
    mixing = _mixing(lights, centre)
    lobes = {_LOBES.get(light.data.type) for light in lights}
    if len(lobes) > 1 or None in lobes:
        return LightRig(directions @ to_camera.T, mixing)
    places = np.array([*(light.matrix_world.translation for light in lights), centre])
    *positions, target = (places - np.array(camera.matrix_world.translation)) @ to_camera.T
    return near_rig(positions, target, mixing, lobes.pop() or 0.0)


def rig_parts(scene: Any) -> tuple[Any, Any, list[Any]]:
    """The rig's camera, target and three lights. Raises InputError where one is missing."""
    settings = scene.mps.rig
    camera = rig_camera(scene)
    in_scene = set(scene.objects)
    if settings.target not in in_scene:
        raise InputError("the rig's target was deleted; add the rig again")
    lights = [light.object for light in settings.lights]
    if len(lights) != len(COLOURS):
        raise InputError(f"the rig has {len(lights)} lights, not a red, a green and a blue one; add the rig again")
    for colour, light in zip(COLOURS, lights, strict=True):
        if light is None or light not in in_scene or light.type != "LIGHT":
            raise InputError(f"the rig's {colour.lower()} light was deleted; add the rig again")
        if light.hide_render:
            raise InputError(f"the rig's {colour.lower()} light is hidden from renders; show it again")
    return camera, settings.target, lights


def rig_camera(scene: Any) -> Any:
    """The rig's camera. Raises InputError where there is none."""
    settings = scene.mps.rig
    if not settings.lights:
        raise InputError("there is no rig in this scene; select the object and add one first")
    if settings.camera not in set(scene.objects):
        raise InputError("the rig's camera was deleted; add the rig again")
    if settings.camera.type != "CAMERA":
        raise InputError(f'the rig\'s camera "{settings.camera.name}" is not a camera; add the rig again')
    return settings.camera


def _direction(light: Any, centre: Vector) -> Vector:
    if light.data.type == "SUN":
        return light.matrix_world.to_3x3().col[2].normalized()
    direction = light.matrix_world.translation - centre
    if direction.length < 1e-9:
        raise InputError(f'light "{light.name}" stands in the rig\'s target; move it away from the object')
    return direction.normalized()


def _mixing(lights: Iterable[Any], centre: Vector) -> NDArray[np.float64]:
    columns = np.stack([_brightness(light, centre) for light in lights], axis=-1)
    if columns.max() <= 0:
        raise InputError("the rig's lights are all black; give them their strength back")
    return columns / columns.max()


def _brightness(light: Any, centre: Vector) -> NDArray[np.float64]:
    """(3,) red, green and blue that the light brings to the target."""
    data = light.data
    colour = np.array(data.color) * data.energy * 2.0**data.exposure
    if data.use_temperature:
        colour *= np.array(data.temperature_color)
    if data.type == "SUN":
        return colour / math.pi
    return colour / _area_power((light.matrix_world.translation - centre).length)


CLASSES = (MPS_OT_add_rig, MPS_OT_remove_rig)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
