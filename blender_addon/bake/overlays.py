"""Overlays: copies that stand over objects in the viewport and show them in other materials."""

from collections.abc import Sequence
from typing import Any

import bpy

from ..appearance.nodes import NORMAL_NODE, TEXTURE_NODE, find_node
from ..scene.surfaces import bounding_sphere

# Offset of the copy from the object's surface, to make it visible, as a fraction of the object's radius.
_OUT = 2e-3


def baked_texture(material: Any) -> tuple[Any, str] | None:
    """The baked texture in a material, with its UV map; None if there is none."""
    tree = material.node_tree if material else None
    texture, normal = (find_node(tree, name) for name in (TEXTURE_NODE, NORMAL_NODE)) if tree else (None, None)
    if texture is None or texture.image is None:
        return None
    return texture.image, normal.uv_map if normal is not None else ""


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
