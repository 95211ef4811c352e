"""Assignment of baked textures to materials."""

from collections.abc import Sequence
from typing import Any

import bpy

from ..appearance.displacement import remove_displacement, remove_object_normals
from ..appearance.nodes import (
    ALBEDO_NODE,
    GREEN_NODE,
    NORMAL_NODE,
    TEXTURE_NODE,
    ensure_node,
    find_node,
    texture_on_uvs,
)
from ..appearance.shader_graph import normal_inputs, shaders_of, way_in
from ..image_records import remember
from .texture_sets import AssignedTexture, ensure_own_materials, store_owners


def assign_textures(
    assigned: Sequence[AssignedTexture], space: str, convention: str, frames: range = range(0)
) -> list[str]:
    """Assign textures to all materials of objects.

    Materials without a shader that takes a normal and reaches the output are skipped. Returns a sentence for each node
    that a texture replaced, and for each object whose displacement was removed: with a tangent-space normal map, the
    relief would show twice.

    frames: of the timeline, if the texture is an image sequence with these frame numbers.
    """
    materials = ensure_own_materials(assigned)
    store_owners(assigned)
    sentences = [
        f'The displacement of "{one.target.name}" is off, it would show the relief twice; displace the object again'
        for one in assigned
        if space == "TANGENT" and remove_displacement(one.target)
    ]
    for material, (image, uv_map) in materials.items():
        if not normal_inputs(material)[0]:
            continue
        # Later steps read these from the texture, because the panel may have changed by then.
        remember(image, "space", space)
        remember(image, "convention", convention)
        remove_object_normals(material)
        for name in assign_normal_map(material, image, uv_map, space, convention):
            sentences.append(f'The texture took the place of "{name}" in material "{material.name}"')
        if frames:
            shown = material.node_tree.nodes[TEXTURE_NODE].image_user
            shown.frame_start, shown.frame_offset, shown.frame_duration = frames[0], frames[0] - 1, len(frames)
            shown.use_auto_refresh = True
    return sentences


def assign_albedo(assigned: Sequence[AssignedTexture]) -> list[str]:
    """Assign albedos as base colours to all materials of objects.

    Returns a sentence for each node that one replaced, and for each material that cannot take one.
    """
    materials, sentences = ensure_own_materials(assigned), []
    store_owners(assigned)
    for material, (image, uv_map) in materials.items():
        links = material.node_tree.links
        ends = [shader.end(_base_colour(shader.node)) for shader in shaders_of(material, all_engines=True)]
        colours = list(dict.fromkeys(socket for end in ends if end and (socket := way_in(end))))
        if not colours:
            sentences.append(f'Material "{material.name}" has no shader with a base colour for "{image.name}"')
            continue
        shader = colours[0].node
        x, y = shader.location.x, shader.location.y
        texture = texture_on_uvs(material.node_tree, ALBEDO_NODE, image, uv_map, x - 400, y)
        before = {link.from_node.name for socket in colours for link in socket.links} - {texture.name}
        sentences += [f'The albedo took the place of "{name}" in material "{material.name}"' for name in sorted(before)]
        for socket in colours:
            links.new(texture.outputs["Color"], socket)
    return sentences


def _base_colour(node: Any) -> str:
    """The name of a shader's input for the surface colour, if it has one."""
    return "Color" if node.type == "BSDF_DIFFUSE" else "Base Color"


def mark_assets(assigned: Sequence[AssignedTexture], what: str) -> None:
    """Mark the textured "MATERIAL" or "OBJECT" as asset, or "NONE"."""
    materials = [slot.material for one in assigned for slot in one.target.material_slots]
    for datablock in {"NONE": [], "MATERIAL": materials, "OBJECT": [one.target for one in assigned]}[what]:
        mark_asset(datablock)


def mark_asset(datablock: Any) -> None:
    datablock.asset_mark()
    if not bpy.app.background:  # previews need a window
        datablock.asset_generate_preview()


def assign_normal_map(material: Any, image: Any, uv_map: str, space: str, convention: str) -> list[str]:
    """Link the texture to the normal of every shader that reaches the output. Nodes of an earlier bake are reused.

    material: one with such a shader. Returns the names of the nodes that were linked there before,
    except those of an earlier bake.
    """
    found, _ = normal_inputs(material)
    places = [socket.node.location for socket in found]
    left, top = min(place.x for place in places), min(place.y for place in places) - 300
    normal = ensure_normal_map(material.node_tree, image, uv_map, space, convention, left, top)
    before = [link.from_node for socket in found for link in socket.links]
    for socket in found:
        material.node_tree.links.new(normal.outputs["Normal"], socket)
    return list(dict.fromkeys(other.name for other in before if other != normal))


def ensure_normal_map(tree: Any, image: Any, uv_map: str, space: str, convention: str, left: float, top: float) -> Any:
    """The tree's Normal Map node for the texture, created with its input nodes if needed. left: its x position."""
    links = tree.links
    texture = texture_on_uvs(tree, TEXTURE_NODE, image, uv_map, left - 800, top)
    normal = ensure_node(tree, NORMAL_NODE, left - 200, top)
    normal.uv_map, normal.space = uv_map, space
    colour = texture.outputs["Color"]
    if convention == "DIRECTX":
        # Blender 4.5's Normal Map node only supports OpenGL; a node that inverts green works in every version.
        turn = ensure_node(tree, GREEN_NODE, left - 400, top)
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        links.new(colour, turn.inputs[0])
        colour = turn.outputs["Vector"]
    elif turn := find_node(tree, GREEN_NODE):
        tree.nodes.remove(turn)
    links.new(colour, normal.inputs["Color"])
    return normal
