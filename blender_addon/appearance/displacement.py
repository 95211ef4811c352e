"""Displacement of an object by heights in its materials, with its normals in object space if requested."""

from typing import Any

from .modifiers import DISPLACE, SMOOTHNESS, SUBDIVISION, find_modifier, remove_modifier
from .nodes import (
    BEFORE_NODE,
    DISPLACEMENT_NODE,
    HEIGHT_NODE,
    NORMAL_NODE,
    OBJECT_NORMAL_NODE,
    OBJECT_TEXTURE_NODE,
    ensure_node,
    find_node,
    texture_on_uvs,
)
from .shader_graph import normal_inputs, output_of

# Stored with a material: its displacement method before it got heights.
_METHOD_BEFORE = "mpsnet_displacement_method"
# Stored with a material: whether Cycles corrected its normals before it got those in object space.
_CORRECTION_BEFORE = "mpsnet_bump_map_correction"


def assign_displacement(material: Any, image: Any, uv_map: str, strength: float, midlevel: float) -> list[str]:
    """Link the heights to the displacement of a material that has an output, in object space.

    Nodes of an earlier run are reused. Returns the name of the node that was linked there before, except one of an
    earlier run; :func:`remove_heights` restores it.
    """
    tree, output = material.node_tree, output_of(material)
    left, top = output.location.x, output.location.y - 700
    heights = texture_on_uvs(tree, HEIGHT_NODE, image, uv_map, left - 600, top)
    displacement = ensure_node(tree, DISPLACEMENT_NODE, left - 300, top)
    # Like a modifier: along the object's own normals, rotated and scaled with it.
    displacement.space = "OBJECT"
    displacement.inputs["Midlevel"].default_value = midlevel
    displacement.inputs["Scale"].default_value = strength
    tree.links.new(heights.outputs["Color"], displacement.inputs["Height"])
    before = [link.from_socket for link in output.inputs["Displacement"].links if link.from_node != displacement]
    for socket in before:  # a node keeps the link, which survives renaming
        tree.links.new(socket, ensure_node(tree, BEFORE_NODE, left, top).inputs[0])
    if before or _METHOD_BEFORE not in material:
        material[_METHOD_BEFORE] = material.displacement_method
    tree.links.new(displacement.outputs["Displacement"], output.inputs["Displacement"])
    material.displacement_method = "BOTH"
    return [socket.node.name for socket in before]


def remove_heights(material: Any) -> list[str]:
    """Remove the heights from a material, and restore its previous displacement. Returns that node's name."""
    tree, output = material.node_tree, output_of(material)
    for node in [find_node(tree, name) for name in (DISPLACEMENT_NODE, HEIGHT_NODE)]:
        if node is not None:
            tree.nodes.remove(node)
    method, reroute = material.pop(_METHOD_BEFORE, None), find_node(tree, BEFORE_NODE)
    before = [link.from_socket for link in reroute.inputs[0].links] if reroute is not None else []
    if reroute is not None:
        tree.nodes.remove(reroute)
    if output is None or output.inputs["Displacement"].is_linked:  # the user has linked another node since
        return []
    if isinstance(method, str) and method in material.bl_rna.properties["displacement_method"].enum_items:
        material.displacement_method = method
    for socket in before:
        tree.links.new(socket, output.inputs["Displacement"])
    return [socket.node.name for socket in before]


def remove_displacement(target: Any) -> bool:
    """Undo ``mps.displace`` on an object, before it gets another normal map. Returns whether there was anything."""
    materials = [slot.material for slot in target.material_slots if slot.material and slot.material.node_tree]
    displacing = [material for material in materials if find_node(material.node_tree, DISPLACEMENT_NODE)]
    if not find_modifier(target, DISPLACE) and not displacing:
        return False
    for name in (DISPLACE, SUBDIVISION, SMOOTHNESS):
        remove_modifier(target, name)
    for material in displacing:
        remove_heights(material)
    return True


def show_normals(material: Any, shown: bool) -> bool:
    """Link the baked normal map to the material's shaders, or unlink it. Returns whether it was unlinked."""
    normal = find_node(material.node_tree, NORMAL_NODE)
    if normal is None:
        return False
    _link_normal(material, normal, shown)
    return not shown


def show_object_normals(material: Any, image: Any, uv_map: str) -> None:
    """Link the normals in object space to the material's shaders, in place of the baked normal map."""
    show_normals(material, False)
    tree = material.node_tree
    baked = find_node(tree, NORMAL_NODE)
    left, top = (baked.location.x, baked.location.y - 250) if baked is not None else (-600, -600)
    texture = texture_on_uvs(tree, OBJECT_TEXTURE_NODE, image, uv_map, left - 600, top)
    normal = ensure_node(tree, OBJECT_NORMAL_NODE, left, top)
    normal.space = "OBJECT"
    tree.links.new(texture.outputs["Color"], normal.inputs["Color"])
    _link_normal(material, normal, True)
    disable_bump_correction(material)


def disable_bump_correction(material: Any) -> None:
    """Switch off Cycles' bump map correction, until :func:`remove_object_normals`."""
    if hasattr(material, "cycles"):
        # The correction darkens where normals and surface differ, for surfaces without relief; this one is displaced.
        if _CORRECTION_BEFORE not in material:
            material[_CORRECTION_BEFORE] = material.cycles.use_bump_map_correction
        material.cycles.use_bump_map_correction = False


def remove_object_normals(material: Any) -> None:
    """Undo :func:`show_object_normals` and :func:`disable_bump_correction` on a material."""
    for name in (OBJECT_TEXTURE_NODE, OBJECT_NORMAL_NODE):
        node = find_node(material.node_tree, name)
        if node is not None:
            material.node_tree.nodes.remove(node)
    before = material.pop(_CORRECTION_BEFORE, None)
    if before is not None and hasattr(material, "cycles"):
        material.cycles.use_bump_map_correction = bool(before)


def _link_normal(material: Any, normal: Any, linked: bool) -> None:
    """Link a Normal Map node to the shaders whose normal input is free, or unlink it."""
    links = material.node_tree.links
    for socket in normal_inputs(material)[0]:
        if linked and not socket.is_linked:
            links.new(normal.outputs["Normal"], socket)
        for link in [link for link in socket.links if link.from_node == normal and not linked]:
            links.remove(link)
