"""The rig: three coloured lights and a camera around an object, added and removed."""

import math
from collections.abc import Iterable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import FULL_FRAME
from mpsnet_core.scene.rig import direction_from_angles

from ..operators.reporting import ReportingOperator
from ..scene.objects import refuse_linked_scene, refuse_unselectable
from ..scene.surfaces import sphere_around, surface_points
from ..settings.declared import apply_given_settings
from ..settings.messages import in_blender
from ..settings.rig import RigSettings
from .light_rig import COLOURS, area_power

COLLECTION = "MPS Rig"
# Least distance of a perspective camera from the nearest point, in radii of the object.
_NEAREST = 0.1

# Columns are the camera's x, y and z axes in world space.
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
            cls.poll_message_set(in_blender("Switch to Object Mode first"))
            return False
        try:
            _selected(context)
        except InputError as error:
            cls.poll_message_set(in_blender(str(error)))
            return False
        return True

    def act(self, context: Any) -> None:
        apply_given_settings(self, context.scene.mps.rig)
        add_rig(context)


class MPS_OT_remove_rig(bpy.types.Operator):
    """Remove the rig's lights, camera and target"""

    bl_idname = "mps.remove_rig"
    bl_label = "Remove Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.scene.mps.rig.target is None:
            cls.poll_message_set(in_blender("There is no rig in this scene"))
            return False
        return True

    def execute(self, context: Any) -> set[Any]:
        remove_rig(context.scene)
        return {"FINISHED"}


def add_rig(context: Any) -> None:
    """Build the rig around the selected objects with the scene's settings, and replace an earlier one.

    Raises InputError if nothing with a surface is selected.
    """
    scene, settings = context.scene, context.scene.mps.rig
    refuse_linked_scene(scene)
    selected = _selected(context)
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
    """Remove the rig's objects, and its collection unless it contains something else.

    A copy of a scene refers to the original's rig, which is kept there.
    """
    settings = scene.mps.rig
    elsewhere = {obj for other in bpy.data.scenes if other != scene for obj in other.objects}
    for obj in list(rig_objects(scene)):
        if obj in elsewhere:
            continue
        data = obj.data
        bpy.data.objects.remove(obj)
        if isinstance(data, bpy.types.Camera) and not data.users:
            bpy.data.cameras.remove(data)
        elif isinstance(data, bpy.types.Light) and not data.users:
            bpy.data.lights.remove(data)
    collection = settings.collection
    if collection is not None and not collection.objects and not collection.children:
        bpy.data.collections.remove(collection)
    elif collection in set(scene.collection.children) and not elsewhere.isdisjoint(collection.objects):
        scene.collection.children.unlink(collection)
    settings.target = settings.collection = None
    settings.lights.clear()


def rig_objects(scene: Any) -> Iterable[Any]:
    """The rig's own objects that still exist in the file: lights, camera, target.

    An existing camera that takes the rig's photos is not one of them.
    """
    settings = scene.mps.rig
    every = [light.object for light in settings.lights] + [settings.target]
    around = settings.collection.objects if settings.collection is not None else ()
    cameras = [obj for obj in around if obj.type == "CAMERA" and obj.parent == settings.target]
    return [obj for obj in (*every, *cameras) if obj is not None]


def _selected(context: Any) -> list[Any]:
    """The selected objects that are not the rig's own. Raises InputError if there are none."""
    old, objects = set(rig_objects(context.scene)), context.view_layer.objects
    selected = [obj for obj in objects.selected if obj not in old]
    if not selected:
        if objects.active is not None:  # a click in the outliner can make a hidden object active
            refuse_unselectable(objects.active)
        raise InputError("nothing is selected; select the object that the rig goes around")
    return selected


def _orientation(context: Any, view: str) -> Matrix:
    if view != "VIEWPORT":
        return Matrix(_VIEWS[view]).transposed()
    region = getattr(context, "region_data", None)
    if region is None:
        raise InputError('view "VIEWPORT" needs a 3D viewport to take it from; choose "FRONT" or another side')
    return region.view_rotation.to_matrix()


def _add_camera(scene: Any, seen: NDArray[np.float64], radius: float) -> Any:
    """A camera that looks along the target's -z axis, at the distance where the object fits the photo with its margin.

    seen: (N, 3) points of the surface in the target's axes. radius: their largest distance from the target.
    """
    settings, photo = scene.mps.rig, scene.mps.photo
    data = bpy.data.cameras.new("MPS Camera")
    data.sensor_fit, data.sensor_width, data.lens = "AUTO", FULL_FRAME, settings.focal_length
    # (2,) the part of the image that the object may fill, in units of its longer side.
    fill = np.array([photo.width, photo.height]) / max(photo.width, photo.height) / (1 + settings.margin)
    if settings.projection == "ORTHOGRAPHIC":
        data.type = "ORTHO"
        data.ortho_scale = float((np.ptp(seen[:, :2], axis=0) / fill).max())
        place = np.array([0, 0, max(settings.distance, 2.0) * radius])
    else:
        data.type = "PERSP"
        place = _camera_position_in_view(seen, fill * FULL_FRAME / 2 / settings.focal_length, radius)
    nearest, away = place[2] - seen[:, 2].max(), place[2]
    # A range with room to move the object within the rig, and a better depth precision than 0.1 mm to 1 km.
    data.clip_start, data.clip_end = nearest / 100, (away + radius) * 10
    camera = bpy.data.objects.new("MPS Camera", data)
    camera.location = place
    return camera


def _camera_position_in_view(
    seen: NDArray[np.float64], slopes: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """(3,) the nearest camera position with points (N, 3) in view, along -z, of a frustum with side slopes (2,)."""
    # Each side of the frustum is a plane that moves with the camera; its outermost point bounds the position.
    reach = seen[:, 2:] * slopes
    high, low = (seen[:, :2] + reach).max(axis=0), (reach - seen[:, :2]).max(axis=0)
    away = ((high + low) / (2 * slopes)).max()
    return np.array([*(high - low) / 2, max(away, seen[:, 2].max() + _NEAREST * radius)])


def _add_light(settings: Any, name: str, location: Vector) -> Any:
    """A light of pure colour at `location` in the target's axes, which tracks the target when it is moved."""
    reach, angle = location.length, math.radians(settings.light_size)
    data = bpy.data.lights.new(f"MPS {name}", settings.light_type)
    data.color = COLOURS[name]
    if settings.light_type == "SUN":
        data.angle = angle
        data.energy = settings.strength * math.pi
    else:
        data.shape = "DISK"
        data.size = max(2 * reach * math.tan(angle / 2), 1e-4 * reach)
        data.energy = settings.strength * area_power(reach)
    light = bpy.data.objects.new(f"MPS {name}", data)
    light.location = location
    light.rotation_euler = location.to_track_quat("Z", "Y").to_euler()
    aim = light.constraints.new("DAMPED_TRACK")
    aim.name, aim.target, aim.track_axis = "MPS Aim", settings.target, "TRACK_NEGATIVE_Z"
    return light
