"""Coverage: the texels that the views of the last bake saw, shown by copies that stand over the objects."""

import json
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import bpy

from mpsnet_core.errors import InputError

from ..appearance.nodes import NORMAL_NODE, find_node, image_in, new_material
from ..image_records import from_json
from ..operators.reporting import ReportingOperator
from ..scene.objects import refuse_linked_scene
from ..scene.surfaces import bounding_sphere

NAME = "MPS Coverage"
# Lowest coverage value and colour of unseen, filled and seen texels.
_COLOURS = ((0.0, (0.35, 0.03, 0.02, 1)), (0.1, (0.8, 0.35, 0.03, 1)), (0.9, (0.07, 0.4, 0.1, 1)))
# Offset of the copy from the object's surface, to make it visible, as a fraction of the object's radius.
_OUT = 2e-3


class MPS_OT_show_coverage(ReportingOperator, bpy.types.Operator):
    """Show on the objects what the views saw: green there, orange where it is filled, red elsewhere.

    The objects and their materials stay as they are: copies that no render shows stand over them. Press again to end
    it"""

    bl_label = "Show Coverage"

    @classmethod
    def lacks(cls, context: Any) -> str:
        bake = context.scene.mps.bake
        known = bake.image is not None and bake.image.mps.coverage is not None
        return "" if known or bake.overlays else "Bake the texture first"

    def act(self, context: Any) -> None:
        if context.scene.mps.bake.overlays:
            _end(context.scene.mps.bake)
        else:
            _begin(context)


def coverage_folder() -> str:
    """A new folder for a bake's coverage maps. :func:`store_coverage` packs them into the .blend file."""
    return tempfile.mkdtemp(prefix="coverage_", dir=bpy.app.tempdir)


def store_coverage(texture: Any, coverage: Any) -> None:
    """Store a texture's coverage with it, in place of the previous bake's."""
    before, texture.mps.coverage = texture.mps.coverage, coverage
    if before is not None and not before.users:
        bpy.data.images.remove(before)


def hides_materials(space: Any) -> bool:
    """Whether a space is a viewport whose shading mode shows no materials."""
    return space is not None and space.type == "VIEW_3D" and space.shading.type in {"WIREFRAME", "SOLID"}


def _begin(context: Any) -> None:
    scene = context.scene
    refuse_linked_scene(scene)
    shown = [obj for obj in scene.objects if any(_assigned(obj)) and obj.visible_get()]
    if not shown:
        raise InputError("no object that uses a baked texture is visible; show one")
    for obj in shown:
        of_slots = [_material(*one) if one else None for one in _assigned(obj)]
        add_overlay(context, obj, NAME, of_slots, scene.mps.bake.overlays)
    space = context.space_data
    if hides_materials(space):
        place = [context.screen.name, list(context.screen.areas).index(context.area)]
        scene.mps.bake.shading = json.dumps([*place, space.shading.type])
        space.shading.type = "MATERIAL"


def _end(bake: Any) -> None:
    remove_overlays(bake.overlays)
    # Restore the viewport in which it was started, wherever it is ended. A hostile file may hold anything.
    with suppress(ValueError, KeyError, IndexError, TypeError, AttributeError):
        screen, area, before = from_json(bake.shading, list)
        shading = bpy.data.screens[screen].areas[area].spaces.active.shading
        if shading.type == "MATERIAL":
            shading.type = before
    bake.shading = ""


def _assigned(obj: Any) -> list[tuple[Any, str] | None]:
    """For each material slot of an object, the coverage of its texture with the UV map; None if it has none."""
    slots = obj.material_slots if obj.type == "MESH" else ()
    found = [baked_texture(slot.material) for slot in slots]
    return [None if one is None or one[0].mps.coverage is None else (one[0].mps.coverage, one[1]) for one in found]


def _material(coverage: Any, uv_map: str) -> Any:
    material = new_material(NAME)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Roughness"].default_value = 1
    uv, texture, colours = (nodes.new(f"ShaderNode{kind}") for kind in ("UVMap", "TexImage", "ValToRGB"))
    uv.uv_map, texture.image, texture.interpolation = uv_map, coverage, "Closest"
    ramp = colours.color_ramp
    ramp.interpolation = "CONSTANT"
    ramp.elements.new(0.5)
    for element, (start, colour) in zip(ramp.elements, _COLOURS, strict=True):
        element.position, element.color = start, colour
    links.new(uv.outputs["UV"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], colours.inputs["Fac"])
    links.new(colours.outputs["Color"], shader.inputs["Base Color"])
    return material


def baked_texture(material: Any) -> tuple[Any, str] | None:
    """The baked texture in a material, with its UV map; None if there is none."""
    tree = material.node_tree if material else None
    if not tree or (image := image_in(tree)) is None:
        return None
    normal = find_node(tree, NORMAL_NODE)
    return image, normal.uv_map if normal is not None else ""


def add_overlay(context: Any, obj: Any, name: str, materials: Sequence[Any], overlays: Any) -> None:
    """Let a copy stand over an object that no render shows. materials: of its slots.

    overlays: the collection that remembers it, for :func:`remove_overlays`.
    """
    _, radius = bounding_sphere(context.evaluated_depsgraph_get(), [obj])
    overlay = obj.copy()
    overlay.name = name
    overlay.hide_render = overlay.hide_select = True
    overlays.add().object = overlay
    context.scene.collection.objects.link(overlay)
    for slot, material in zip(overlay.material_slots, materials, strict=True):
        if material != slot.material:
            slot.link = "OBJECT"
            slot.material = material
    out = overlay.modifiers.new(name, "DISPLACE")
    out.strength, out.mid_level = _OUT * radius / max(max(map(abs, obj.matrix_world.to_scale())), 1e-9), 0


def remove_overlays(overlays: Any) -> None:
    """Remove the copies, and their materials unless something else uses them."""
    for overlay in [one.object for one in overlays]:
        if overlay is None:
            continue
        materials = [slot.material for slot in overlay.material_slots if slot.link == "OBJECT"]
        bpy.data.objects.remove(overlay)
        for material in dict.fromkeys(materials):
            if material is not None and not material.users:
                bpy.data.materials.remove(material)
    overlays.clear()
