"""Nodes that the add-on creates in materials. A step finds them again by name, so it can be run any number of times."""

from typing import Any

import bpy

# Nodes of the bake, of the displacement, and of both.
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
    for shader in shaders(material.node_tree):
        for name, value in look.items():
            shader.inputs[name].default_value = value
    return material


def trees_of(obj: Any) -> list[Any]:
    """The node trees of an object's materials, slot by slot, without empty slots and materials without nodes."""
    return [slot.material.node_tree for slot in obj.material_slots if slot.material and slot.material.node_tree]


def shaders(tree: Any) -> list[Any]:
    """A tree's shaders that take a normal."""
    return [node for node in tree.nodes if "Normal" in node.inputs and any(o.type == "SHADER" for o in node.outputs)]


def output_before(socket: Any) -> Any:
    """The output that an input is linked to, through reroutes; None if it is not linked."""
    found = socket.links[0].from_socket if socket.links else None
    return output_before(found.node.inputs[0]) if found is not None and found.node.type == "REROUTE" else found


def node_before(node: Any, socket: str | int) -> Any:
    """The node that an input is linked to, through reroutes; None if it is not linked."""
    found = output_before(node.inputs[socket])
    return None if found is None else found.node


def find_node(tree: Any, name: str) -> Any:
    """The tree's node of that name, None if there is none. A node of another type is ignored."""
    found = tree.nodes.get(name)
    return found if found is not None and found.bl_idname == _KINDS[name] else None


def ensure_node(tree: Any, name: str, kind: str, x: float, y: float) -> Any:
    """The tree's node of that name, created at a position if missing. A node of another type is renamed."""
    found = tree.nodes.get(name)
    if found is not None and found.bl_idname != kind:
        found.name, found = found.bl_label, None
    if found is None:
        found = tree.nodes.new(kind)
        found.name = found.label = name
        found.location = (x, y)
    return found
