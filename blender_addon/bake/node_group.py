"""The baked texture and its heights, if any, as a node group for any material."""

from typing import Any

import bpy

from mpsnet_core.errors import InputError

from ..appearance.nodes import (
    DISPLACEMENT_NODE,
    GREEN_NODE,
    HEIGHT_NODE,
    NORMAL_NODE,
    TEXTURE_NODE,
    ensure_node,
    find_node,
    image_in,
    texture_on_uvs,
    trees_of,
)
from ..operators.reporting import ReportingOperator
from ..scene.objects import target_of
from .assign_textures import ensure_normal_map, mark_asset

# Stored with a group that was made here: its texture, which identifies it when it is updated.
_SHOWS = "mpsnet_surface_of"
_SCALE_NODE = "MPS Scale"
_FRAMES = ("frame_start", "frame_offset", "frame_duration", "use_cyclic", "use_auto_refresh")


class MPS_OT_make_node_group(ReportingOperator, bpy.types.Operator):
    """Make a node group of the baked texture, and of its heights where there are, to drag into other materials.

    The Asset Browser shows it. Press again after another bake or displacement"""

    bl_label = "Make Node Group"
    requires = "bake"

    def act(self, context: Any) -> None:
        target = target_of(context)
        trees = set(trees_of(target)) if target is not None else set()
        # Materials may share a texture, and so the group.
        groups = {surface_group(tree) for tree in trees if find_node(tree, NORMAL_NODE) and image_in(tree) is not None}
        if not groups:
            name = f'"{target.name}"' if target is not None else "the active object"
            raise InputError(f"{name} uses no baked texture; choose the object that it was baked onto")
        for group in groups:
            mark_asset(group)
        self.tell(f"Made {', '.join(sorted(group.name for group in groups))}; find it in the Asset Browser")


def surface_group(tree: Any) -> Any:
    """A node group with the nodes of a bake and a displacement in a material's tree.

    An existing group with the same texture is updated. Its outputs are Normal and, if there are heights, Displacement.
    Both show the same relief, scaled by Strength.
    """
    image = image_in(tree)
    known = (one for one in bpy.data.node_groups if one.get(_SHOWS) == image and not one.library)
    group: Any = next(known, None)
    if group is None:
        group = bpy.data.node_groups.new(f"MPS Surface {image.name.removeprefix('MPS ')}", "ShaderNodeTree")
        group[_SHOWS] = image
    inputs = ensure_node(group, "Group Input", -1000, 200, "NodeGroupInput")
    outputs = ensure_node(group, "Group Output", 300, 0, "NodeGroupOutput")
    before = find_node(tree, NORMAL_NODE)
    convention = "DIRECTX" if find_node(tree, GREEN_NODE) else "OPENGL"
    normal = ensure_normal_map(group, image, before.uv_map, before.space, convention, 200, 0)
    source, copy = (one.nodes[TEXTURE_NODE].image_user for one in (tree, group))
    for name in _FRAMES:
        setattr(copy, name, getattr(source, name))
    if not _sockets(group):  # nodes in other materials would keep a default that is set later
        group.interface.new_socket("Strength", in_out="INPUT", socket_type="NodeSocketFloat").default_value = 1.0
    _ensure_output(group, "Normal")
    group.links.new(inputs.outputs["Strength"], normal.inputs["Strength"])
    group.links.new(normal.outputs["Normal"], outputs.inputs["Normal"])
    heights, displaced = image_in(tree, HEIGHT_NODE), find_node(tree, DISPLACEMENT_NODE)
    if heights is None or displaced is None:
        _remove_displacement(group)
        return group
    picture = texture_on_uvs(group, HEIGHT_NODE, heights, before.uv_map, -600, -400)
    displacement = ensure_node(group, DISPLACEMENT_NODE, 0, -400)
    displacement.space = displaced.space
    displacement.inputs["Midlevel"].default_value = displaced.inputs["Midlevel"].default_value
    _ensure_output(group, "Displacement")
    group.links.new(picture.outputs["Color"], displacement.inputs["Height"])
    times = ensure_node(group, _SCALE_NODE, -300, -600, "ShaderNodeMath")
    times.operation = "MULTIPLY"
    times.inputs[1].default_value = displaced.inputs["Scale"].default_value
    group.links.new(inputs.outputs["Strength"], times.inputs[0])
    group.links.new(times.outputs["Value"], displacement.inputs["Scale"])
    group.links.new(displacement.outputs["Displacement"], outputs.inputs["Displacement"])
    return group


def _sockets(group: Any) -> dict[str, Any]:
    return {one.name: one for one in group.interface.items_tree if one.item_type == "SOCKET"}


def _ensure_output(group: Any, name: str) -> None:
    if name not in _sockets(group):
        group.interface.new_socket(name, in_out="OUTPUT", socket_type="NodeSocketVector")


def _remove_displacement(group: Any) -> None:
    """Remove the nodes of an earlier displacement from the group."""
    for name in (HEIGHT_NODE, DISPLACEMENT_NODE, _SCALE_NODE):
        if node := group.nodes.get(name):
            group.nodes.remove(node)
    if socket := _sockets(group).get("Displacement"):
        group.interface.remove(socket)
