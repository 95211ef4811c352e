"""The scene's rig as the core's LightRig: the current directions of its lights, and how their colours mix."""

import math
from collections.abc import Collection
from typing import Any

import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.scene.rig import LightRig, near_rig

from ..image_records import Provenance, rounded
from ..scene.objects import view_layer

COLOURS = {"Red": (1.0, 0.0, 0.0), "Green": (0.0, 1.0, 0.0), "Blue": (0.0, 0.0, 1.0)}
# Angular falloff of positioned lights, as a power of the cosine: an area light appears smaller from the side.
_LOBES = {"AREA": 1.0, "POINT": 0.0, "SPOT": 0.0}
# The watts at which each kind of light is as bright on its axis as an area light of one watt.
_WATTS = {"AREA": 1.0, "POINT": 4.0, "SPOT": 4.0}


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
    emission = [node for node in data.node_tree.nodes if node.type == "EMISSION"] if data.node_tree else []
    strengths = [
        (
            tuple(node.inputs["Color"].default_value),
            node.inputs["Strength"].default_value,
            node.inputs["Strength"].is_linked,
        )
        for node in emission
    ]
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
