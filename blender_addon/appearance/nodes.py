"""Nodes that the add-on creates in materials. A step finds them again by name, so it can be run any number of times."""

from typing import Any

import bpy

from .shader_graph import shaders_of

# Nodes of the bake, of the displacement, and of both.
TEXTURE_NODE, GREEN_NODE, NORMAL_NODE, ALBEDO_NODE = "MPS Texture", "MPS Green", "MPS Normal", "MPS Albedo"
HEIGHT_NODE, DISPLACEMENT_NODE, BEFORE_NODE = "MPS Height", "MPS Displacement", "MPS Before"
OBJECT_TEXTURE_NODE, OBJECT_NORMAL_NODE = "MPS Object Texture", "MPS Object Normal"
UV_NODE = "MPS UV"


_KINDS = {
    **dict.fromkeys((TEXTURE_NODE, ALBEDO_NODE, HEIGHT_NODE, OBJECT_TEXTURE_NODE), "ShaderNodeTexImage"),
    **dict.fromkeys((NORMAL_NODE, OBJECT_NORMAL_NODE), "ShaderNodeNormalMap"),
    GREEN_NODE: "ShaderNodeVectorMath",
    UV_NODE: "ShaderNodeUVMap",
    DISPLACEMENT_NODE: "ShaderNodeDisplacement",
    BEFORE_NODE: "NodeReroute",
}


def new_material(name: str) -> Any:
    """A new material with nodes. Before Blender 5.0, materials may have none."""
    return with_nodes(bpy.data.materials.new(name))


def with_nodes(material: Any) -> Any:
    """The material with nodes. Before Blender 5.0, one without gets them and keeps its look."""
    if bpy.app.version >= (5, 0) or material.use_nodes:
        return material
    material.use_nodes = True
    look = {
        "Base Color": material.diffuse_color,
        "Metallic": material.metallic,
        "Roughness": material.roughness,
        "Specular IOR Level": material.specular_intensity,
    }
    for shader in shaders_of(material):
        for name, value in look.items():
            shader.node.inputs[name].default_value = value
    return material


def trees_of(obj: Any) -> list[Any]:
    """The node trees of an object's materials, slot by slot, without empty slots and materials without nodes."""
    return [slot.material.node_tree for slot in obj.material_slots if slot.material and slot.material.node_tree]


def find_node(tree: Any, name: str) -> Any:
    """The tree's node of that name, None if there is none. A node of another type is ignored."""
    found = tree.nodes.get(name)
    return found if found is not None and found.bl_idname == _KINDS[name] else None


def image_in(tree: Any, name: str = TEXTURE_NODE) -> Any:
    """The image of the tree's node of that name, by default the baked texture; None if there is none."""
    found = find_node(tree, name)
    return found.image if found is not None else None


def texture_on_uvs(tree: Any, name: str, image: Any, uv_map: str, x: float, y: float) -> Any:
    """The tree's image texture of that name with an image on a UV map, created at a position if missing."""
    uv, texture = ensure_node(tree, UV_NODE, x - 200, y), ensure_node(tree, name, x, y)
    uv.uv_map, texture.image = uv_map, image
    tree.links.new(uv.outputs["UV"], texture.inputs["Vector"])
    return texture


def ensure_node(tree: Any, name: str, x: float, y: float, kind: str = "") -> Any:
    """The tree's node of that name, created at a position if missing. A node of another type is renamed.

    kind: its type, if it is none of the nodes above.
    """
    kind = kind or _KINDS[name]
    found = tree.nodes.get(name)
    if found is not None and found.bl_idname != kind:
        found.name, found = found.bl_label, None
    if found is None:
        found = tree.nodes.new(kind)
        found.name = found.label = name
        found.location = (x, y)
    return found
