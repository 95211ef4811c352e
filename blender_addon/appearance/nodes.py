"""The nodes that the add-on makes in materials: found again by their names, so that a step can be run any number of
times."""

from typing import Any

import bpy

# The bake's, the displacement's, and those that both have.
TEXTURE_NODE, GREEN_NODE, NORMAL_NODE, ALBEDO_NODE = "MPS Texture", "MPS Green", "MPS Normal", "MPS Albedo"
HEIGHT_NODE, DISPLACEMENT_NODE, BEFORE_NODE = "MPS Height", "MPS Displacement", "MPS Before"
OBJECT_TEXTURE_NODE, OBJECT_NORMAL_NODE = "MPS Object Texture", "MPS Object Normal"
UV_NODE = "MPS UV"


_KINDS = {
    TEXTURE_NODE: "ShaderNodeTexImage",
    GREEN_NODE: "ShaderNodeVectorMath",
    NORMAL_NODE: "ShaderNodeNormalMap",
    ALBEDO_NODE: "ShaderNodeTexImage",
    HEIGHT_NODE: "ShaderNodeTexImage",
    DISPLACEMENT_NODE: "ShaderNodeDisplacement",
    OBJECT_TEXTURE_NODE: "ShaderNodeTexImage",
    OBJECT_NORMAL_NODE: "ShaderNodeNormalMap",
    BEFORE_NODE: "NodeReroute",
}


def new_material(name: str) -> Any:
    """A new material with nodes; before Blender 5.0 a material may be without."""
    return with_nodes(bpy.data.materials.new(name))


def with_nodes(material: Any) -> Any:
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    return material


def find_node(tree: Any, name: str) -> Any:
    """The tree's node of that name, None where there is none; a node of another kind has the name by chance."""
    found = tree.nodes.get(name)
    return found if found is not None and found.bl_idname == _KINDS[name] else None


def ensure_node(tree: Any, name: str, kind: str, x: float, y: float) -> Any:
    """The tree's node of that name, made at a place where there is none; a node of another kind is renamed."""
    found = tree.nodes.get(name)
    if found is not None and found.bl_idname != kind:
        found.name, found = found.bl_label, None
    if found is None:
        found = tree.nodes.new(kind)
        found.name = found.label = name
        found.location = (x, y)
    return found
