"""Relight: a white lamp swings around the result to show its relief."""

import json
import math
import time
from contextlib import suppress
from typing import Any

import bpy
from bpy.app.handlers import persistent
from mathutils import Euler, Matrix, Vector

from ..appearance.nodes import ALBEDO_NODE, find_node
from ..appearance.shader_graph import shaders_of
from ..image_records import from_json
from ..operators.reporting import ReportingOperator
from ..scene.objects import refuse_linked_scene, remove_object
from ..scene.surfaces import bounding_sphere
from .coverage import add_overlay, baked_texture, remove_overlays

TICK_SECONDS = 1 / 30
SECONDS_A_TURN = 14.0
# A key light that grazes the surface shows its relief; half of what is seen is in shadow.
SLANT, KEY, ANGLE = math.radians(74), 4.0, math.radians(3)
# The fill comes from the other side, nearer to the viewer.
FILL_SLANT, FILL = math.radians(-40), 0.25
NEUTRAL = "MPS Neutral"
# What hides relief is replaced: colours and gloss.
_NEUTRAL = {
    "Base Color": (0.5, 0.5, 0.5, 1.0),
    "Color": (0.5, 0.5, 0.5, 1.0),
    "Metallic": 0.0,
    "Roughness": 0.6,
    "Transmission Weight": 0.0,
    "Subsurface Weight": 0.0,
    "Alpha": 1.0,
}
# Material Preview, lit by these lamps and hardly by its own environment.
_SHADING = {
    "type": "MATERIAL",
    "use_scene_lights": True,
    "use_scene_world": False,
    "studiolight_intensity": 0.02,
    "studiolight_background_alpha": 0.0,
}


class MPS_OT_relight(ReportingOperator, bpy.types.Operator):
    """Let a white lamp swing around what the viewport shows, in place of the rigs' lights. Press again to end it"""

    bl_label = "Relight"

    def act(self, context: Any) -> None:
        begin = context.scene.mps.relight.lamp is None
        if begin:
            refuse_linked_scene(context.scene)
            objects = context.view_layer.objects
            shown = [obj for obj in objects.selected or objects if obj.visible_get()]
            centre, radius = bounding_sphere(context.evaluated_depsgraph_get(), shown)
        _end(context)  # also cleans up after a lamp that was deleted manually
        if begin:
            _begin(context, centre, radius)


def _begin(context: Any, centre: Vector, radius: float) -> None:
    scene, settings = context.scene, context.scene.mps.relight
    settings.pivot = pivot = bpy.data.objects.new("MPS Relight", None)
    pivot.empty_display_size = radius / 4
    pivot.matrix_world = Matrix.Translation(centre) @ _towards_viewer(context).to_4x4()
    settings.lamp = lamp = _sun("MPS White Lamp", KEY, SLANT, pivot, radius)
    fill = _sun("MPS Fill", FILL, FILL_SLANT, pivot, radius)
    for obj in (pivot, lamp, fill):
        obj.hide_render = True
        scene.collection.objects.link(obj)
    if settings.neutral:
        _show_neutral(context)
    layer = context.view_layer
    settings.view_layer = layer.name
    for light in (light.object for one in scene.mps.every_rig for light in one.rig.lights):
        if light is not None and light.name in layer.objects and not light.hide_get():
            light.hide_set(True)
            settings.hidden.add().object = light
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        shading = space.shading
        settings.shading = json.dumps({name: getattr(shading, name) for name in _SHADING})
        _set(shading, _SHADING)
    _swing_on()


def _show_neutral(context: Any) -> None:
    """Let copies in neutral materials stand over visible objects with a baked texture whose albedo is not known."""
    for obj in [obj for obj in context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]:
        materials = [slot.material for slot in obj.material_slots]
        baked = [one for one in materials if baked_texture(one) is not None]
        if baked and not any(find_node(one.node_tree, ALBEDO_NODE) for one in baked):
            neutral = {one: _neutral(one) for one in baked}
            of_slots = [neutral.get(one, one) for one in materials]
            add_overlay(context, obj, NEUTRAL, of_slots, context.scene.mps.relight.overlays)


def _neutral(material: Any) -> Any:
    """A copy of a material with its normal map, grey and without gloss."""
    copied = material.copy()
    copied.name = NEUTRAL
    own = [shader for shader in shaders_of(copied, all_engines=True) if not shader.groups]  # a group is shared
    for shader in own:
        for socket in shader.node.inputs:
            if socket.name in _NEUTRAL:
                for link in socket.links:
                    copied.node_tree.links.remove(link)
                socket.default_value = _NEUTRAL[socket.name]
    return copied


def _sun(name: str, energy: float, slant: float, pivot: Any, radius: float) -> Any:
    data = bpy.data.lights.new(name, "SUN")
    data.energy, data.angle = energy, ANGLE
    sun = bpy.data.objects.new(name, data)
    sun.parent = pivot
    sun.matrix_local = Euler((0, slant, 0)).to_matrix().to_4x4() @ Matrix.Translation((0, 0, 2 * radius))
    return sun


def _end(context: Any) -> None:
    settings = context.scene.mps.relight
    lamps = settings.pivot.children if settings.pivot is not None else ()
    for obj in dict.fromkeys((settings.lamp, *(one for one in lamps if one.type == "LIGHT"), settings.pivot)):
        if obj is not None:
            remove_object(obj)
    layer = context.scene.view_layers.get(settings.view_layer, context.view_layer)
    for light in (light.object for light in settings.hidden):
        if light is not None and light.name in layer.objects:
            light.hide_set(False, view_layer=layer)
    settings.hidden.clear()
    remove_overlays(settings.overlays)
    # Restore the viewport in which it was started: the one that still has this shading.
    areas = [area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"]
    for shading in (area.spaces.active.shading for area in areas) if settings.shading else ():
        if shading.type == _SHADING["type"] and all(
            _alike(getattr(shading, name), _SHADING[name]) for name in _SHADING
        ):
            _set(shading, from_json(settings.shading, dict))
    settings.shading = ""


def _towards_viewer(context: Any) -> Matrix:
    """(3, 3) axes of the viewport, else of the rig, else of a front view. z points to the viewer."""
    if getattr(context, "region_data", None) is not None:
        return context.region_data.view_rotation.to_matrix()
    target = context.scene.mps.rig.target
    return target.matrix_world.to_3x3() if target else Euler((math.pi / 2, 0, 0)).to_matrix()


def _alike(one: Any, other: Any) -> bool:
    """Whether two settings are equal, up to Blender's float32 precision."""
    return bool(one == other or (isinstance(other, float) and math.isclose(one, other, rel_tol=1e-6)))


def _set(shading: Any, values: dict[str, Any]) -> None:
    for name in _SHADING:  # the type first: the other settings depend on it
        with suppress(KeyError, TypeError, ValueError):  # as a hostile file may hold them
            setattr(shading, name, values[name])


_swung_at = 0.0  # time.monotonic()


def _swing() -> float | None:
    """Rotate the lamps of all scenes by the time since the last call. The timer ends if there are none."""
    global _swung_at
    before, _swung_at = _swung_at, time.monotonic()
    pivots = [scene.mps.relight.pivot for scene in bpy.data.scenes if scene.mps.relight.lamp is not None]
    for pivot in pivots:
        if pivot is not None:
            pivot.rotation_euler.rotate_axis("Z", math.tau * (_swung_at - before) / SECONDS_A_TURN)
    return TICK_SECONDS if pivots else None


@persistent
def _swing_on(*_: Any) -> None:
    """Start the timer. Also called for an opened file that was saved while its lamp was swinging."""
    global _swung_at
    if not bpy.app.background and not bpy.app.timers.is_registered(_swing):
        _swung_at = time.monotonic()
        bpy.app.timers.register(_swing)


def pause() -> None:
    """Let the lamp stand still until :func:`resume`: what hides it need not be drawn again."""
    if bpy.app.timers.is_registered(_swing):
        bpy.app.timers.unregister(_swing)


def resume() -> None:
    """Let the lamp swing on, if there is one."""
    _swing_on()


HANDLERS = {"load_post": _swing_on}
TIMERS = (_swing,)
