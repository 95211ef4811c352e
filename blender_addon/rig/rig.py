"""The rig: three coloured lights and a camera around an object, added and removed; and as the core's LightRig.

The latter has the current directions of the lights, and how their colours mix.
"""

import math
from collections.abc import Collection, Iterable
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import FULL_FRAME
from mpsnet_core.scene.rig import LightRig, direction_from_angles, near_rig

from ..image_records import Provenance, rounded
from ..operators.reporting import ReportingOperator
from ..scene.objects import refuse_linked_scene, refuse_unselectable, remove_object, view_layer
from ..scene.surfaces import sphere_around, surface_points
from ..settings.declared import apply_given_settings
from ..settings.rig import RigSettings

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
COLOURS = {"Red": (1.0, 0.0, 0.0), "Green": (0.0, 1.0, 0.0), "Blue": (0.0, 0.0, 1.0)}
# Angular falloff of positioned lights, as a power of the cosine: an area light appears smaller from the side.
_LOBES = {"AREA": 1.0, "POINT": 0.0, "SPOT": 0.0}
# The watts at which each kind of light is as bright on its axis as an area light of one watt.
_WATTS = {"AREA": 1.0, "POINT": 4.0, "SPOT": 4.0}


class MPS_OT_add_rig(ReportingOperator, RigSettings, bpy.types.Operator):
    """Add three coloured lights and a camera around the selected objects, in place of an earlier rig"""

    bl_label = "Add Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        active = context.view_layer.objects.active
        if active is not None and active.mode != "OBJECT":
            return "Switch to Object Mode first"
        try:
            _selected(context)
        except InputError as error:
            return str(error)
        return ""

    def act(self, context: Any) -> None:
        apply_given_settings(self, context.scene.mps.rig)
        add_rig(context)


class MPS_OT_remove_rig(ReportingOperator, bpy.types.Operator):
    """Remove the rig's lights, camera and target"""

    bl_label = "Remove Rig"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.rig.target else "There is no rig in this scene"

    def act(self, context: Any) -> None:
        remove_rig(context.scene)


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
        if obj not in elsewhere:
            remove_object(obj)
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


def light_rig(scene: Any) -> LightRig:
    """The rig with its objects' current positions, in camera space.

    A sun shines along its own axis, wherever it is; any other light shines from its position towards the target. If all
    three are of one such kind, they are near lights, whose directions vary over the image. The mixing matrix follows
    from the lights' colours and their brightness at the target.

    Raises InputError if a part of the rig is missing, the lights' brightness cannot be compared, or their directions do
    not determine a normal.
    """
    view_layer(scene).update()
    return last_evaluated_rig(scene)


def last_evaluated_rig(scene: Any, depsgraph: Any = None) -> LightRig:
    """:func:`light_rig` from Blender's last evaluation of the scene, for panels, which must not evaluate it.

    depsgraph: one that evaluates the rig. The scene's own omits objects that are disabled in viewports.
    """
    camera, target, lights = rig_parts(scene)
    if depsgraph is not None:
        camera, target, *lights = [obj.evaluated_get(depsgraph) for obj in (camera, target, *lights)]
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


def lights_provenance(scene: Any) -> Provenance:
    """The lights' positions and brightness as provenance of a photo; empty if they cannot take a photo."""
    try:
        rig = last_evaluated_rig(scene)
    except InputError:
        return {}
    return {"Lights": rounded(rig.directions, 3) + rounded(rig.mixing, 3)}


def rig_parts(scene: Any) -> tuple[Any, Any, list[Any]]:
    """The rig's camera, target and three lights. Raises InputError if one is missing."""
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
    """The rig's camera. Raises InputError if there is none."""
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


def _mixing(lights: Collection[Any], centre: Vector) -> NDArray[np.float64]:
    if len({_settings_besides_power(light) for light in lights}) > 1:
        raise InputError(
            "the rig's lights differ in spread, normalisation, nodes or whether surfaces see them, so their brightness "
            "cannot be compared; set these alike"
        )
    columns = np.stack([_brightness(light, centre) for light in lights], axis=-1)
    if columns.max() <= 0:
        raise InputError("the rig's lights are all black; give them their strength back")
    return columns / columns.max()


def _settings_besides_power(light: Any) -> tuple[Any, ...]:
    """Settings other than power that change a light's brightness. They do not matter if all three lights share them."""
    data = light.data
    emission = [node.inputs for node in data.node_tree.nodes if node.type == "EMISSION"] if data.node_tree else []
    sockets = [(inputs["Color"], inputs["Strength"]) for inputs in emission]
    strengths = [(tuple(one.default_value), other.default_value, other.is_linked) for one, other in sockets]
    spread = data.spread if data.type == "AREA" else math.pi
    plain = [((1.0, 1.0, 1.0, 1.0), 1.0, False)]
    return (
        round(spread, 4),
        getattr(data, "normalize", True),
        light.visible_diffuse,
        None if not getattr(data, "use_nodes", True) or strengths in ([], plain) else str(strengths),
    )


def _brightness(light: Any, centre: Vector) -> NDArray[np.float64]:
    """(3,) irradiance of the light at the target in red, green and blue, in relative units."""
    data = light.data
    colour = np.array(data.color) * data.energy * 2.0**data.exposure
    if data.use_temperature:
        colour *= np.array(data.temperature_color)
    if data.type == "SUN":
        return colour / math.pi
    return colour / area_power((light.matrix_world.translation - centre).length) / _WATTS[data.type]


def area_power(distance: float) -> float:
    """Watts of an area light that, at `distance`, gives a facing surface the irradiance of a sun of strength π."""
    return (math.pi * distance) ** 2
