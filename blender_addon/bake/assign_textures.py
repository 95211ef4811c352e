"""Textures on materials: what an object wears of a bake."""

from collections.abc import Sequence
from typing import Any

from mpsnet_core.errors import InputError

from ..heights.assign_displacement import remove_displacement, remove_object_normals
from ..nodes import GREEN_NODE, NORMAL_NODE, TEXTURE_NODE, UV_NODE, ensure_node, find_node
from ..outputs import remember
from .texture_owners import store_owners
from .texture_sets import AssignedTexture, own_materials


def assign_textures(
    worn: Sequence[AssignedTexture], space: str, convention: str, frames: range = range(0)
) -> list[str]:
    """Give all materials of objects their textures; returns a sentence for each node whose place a texture took,
    and for each object whose displacement is off now: with a normal map in tangent space the relief would show twice.

    frames: of the timeline, where the texture is an image sequence whose files have their numbers.
    """
    materials = own_materials(worn)
    store_owners(worn)
    sentences = [
        f'The displacement of "{one.target.name}" is off, it would show the relief twice; displace the object again'
        for one in worn
        if space == "TANGENT" and remove_displacement(one.target)
    ]
    for material, (image, uv_map) in materials.items():
        # Later steps read this from the texture: the panel may have changed by then.
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


def assign_normal_map(material: Any, image: Any, uv_map: str, space: str, convention: str) -> list[str]:
    """Give every shader of a material the texture as its normal; nodes of an earlier bake are used again.

    Returns the names of the nodes that were the shaders' normals until now, an earlier bake's apart.

    Raises InputError where no shader of the material takes a normal.
    """
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shaders = [node for node in nodes if node.type.startswith("BSDF") and "Normal" in node.inputs]
    if not shaders:
        raise InputError(f'material "{material.name}" has no shader with a Normal input; add a Principled BSDF to it')
    left, top = min(node.location.x for node in shaders), min(node.location.y for node in shaders) - 300

    def node(name: str, kind: str, steps: int) -> Any:
        return ensure_node(material.node_tree, name, kind, left - 200 * steps, top)

    uv, texture = node(UV_NODE, "ShaderNodeUVMap", 5), node(TEXTURE_NODE, "ShaderNodeTexImage", 4)
    normal = node(NORMAL_NODE, "ShaderNodeNormalMap", 1)
    uv.uv_map = normal.uv_map = uv_map
    texture.image, normal.space = image, space
    links.new(uv.outputs["UV"], texture.inputs["Vector"])
    colour = texture.outputs["Color"]
    if convention == "DIRECTX":
        # Blender 4.5's Normal Map node has OpenGL only; a node that inverts green works in every version.
        turn = node(GREEN_NODE, "ShaderNodeVectorMath", 2)
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        links.new(colour, turn.inputs[0])
        colour = turn.outputs["Vector"]
    elif turn := find_node(material.node_tree, GREEN_NODE):
        nodes.remove(turn)
    links.new(colour, normal.inputs["Color"])
    before = [link.from_node for shader in shaders for link in shader.inputs["Normal"].links]
    for shader in shaders:
        links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    return list(dict.fromkeys(other.name for other in before if other != normal))
