"""Textures on materials: what an object wears of a bake."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from mpsnet_core.errors import InputError
from mpsnet_core.surface.texture_names import tile_patterns

from .displaced import undisplaced
from .mesh_file import DISPLACE
from .nodes import GREEN_NODE, HEIGHT_NODE, NORMAL_NODE, TEXTURE_NODE, UV_NODE, own_node
from .operators import same
from .outputs import remember, remembered
from .present_map import parts_of
from .textures import TILE, Onto, Worn, own_materials


def wear_textures(worn: Sequence[Worn], space: str, convention: str, frames: range = range(0)) -> list[str]:
    """Give all materials of objects their textures; gives a sentence for each node whose place a texture took,
    and for each object whose displacement is off now: with a normal map in tangent space the relief would show twice.

    frames: of the timeline, where the texture is an image sequence whose files have their numbers.
    """
    materials = own_materials(worn)
    keep_wearers(worn)
    sentences = [
        f'The displacement of "{one.target.name}" is off, it would show the relief twice; displace the object again'
        for one in worn
        if space == "TANGENT" and undisplaced(one.target)
    ]
    for material, (image, uv_map) in materials.items():
        # Whoever reads the texture later needs to know, whatever the panel says by then.
        remember(image, "space", space)
        remember(image, "convention", convention)
        for name in wear(material, image, uv_map, space, convention):
            sentences.append(f'The texture took the place of "{name}" in material "{material.name}"')
        if frames:
            shown = material.node_tree.nodes[TEXTURE_NODE].image_user
            shown.frame_start, shown.frame_offset, shown.frame_duration = frames[0], frames[0] - 1, len(frames)
            shown.use_auto_refresh = True
    return sentences


def wear(material: Any, image: Any, uv_map: str, space: str, convention: str) -> list[str]:
    """Give every shader of a material the texture as its normal; nodes of an earlier bake are used again.

    Gives the names of the nodes that were the shaders' normals until now, an earlier bake's apart.

    Raises InputError where no shader of the material takes a normal.
    """
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shaders = [node for node in nodes if node.type.startswith("BSDF") and "Normal" in node.inputs]
    if not shaders:
        raise InputError(f'material "{material.name}" has no shader with a Normal input; add a Principled BSDF to it')
    left, top = min(node.location.x for node in shaders), min(node.location.y for node in shaders) - 300

    def node(name: str, kind: str, steps: int) -> Any:
        return own_node(material.node_tree, name, kind, left - 200 * steps, top)

    uv, texture = node(UV_NODE, "ShaderNodeUVMap", 5), node(TEXTURE_NODE, "ShaderNodeTexImage", 4)
    normal = node(NORMAL_NODE, "ShaderNodeNormalMap", 1)
    uv.uv_map = normal.uv_map = uv_map
    texture.image, normal.space = image, space
    links.new(uv.outputs["UV"], texture.inputs["Vector"])
    colour = texture.outputs["Color"]
    if convention == "DIRECTX":
        # Blender 4.5's Normal Map node knows OpenGL only; a node that turns green round works in every version.
        turn = node(GREEN_NODE, "ShaderNodeVectorMath", 2)
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        links.new(colour, turn.inputs[0])
        colour = turn.outputs["Vector"]
    elif GREEN_NODE in nodes:
        nodes.remove(nodes[GREEN_NODE])
    links.new(colour, normal.inputs["Color"])
    before = [link.from_node for shader in shaders for link in shader.inputs["Normal"].links]
    for shader in shaders:
        links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    return list(dict.fromkeys(other.name for other in before if other != normal))


def keep_wearers(worn: Sequence[Worn]) -> None:
    """Note with each image the names of the objects that it was made for."""
    for image in {image for one in worn for image in one.images}:
        remember(image, "onto", json.dumps([one.target.name for one in worn if image in one.images]))


class _Sheet(NamedTuple):
    tile: int | None
    material: str | None
    object: str | None


def files_for(onto: Sequence[Onto], file: Path) -> dict[Path, list[Any]]:
    """The files that the tokens in `file` stand for, with <UDIM> left as it is, and the objects that each is for."""
    parts, tile = parts_of(onto, file), 1001 if TILE in file.name else None  # whichever: the token stays
    sheets = [_Sheet(tile, material, name) for name, material in parts]
    found: dict[Path, list[Any]] = {}
    for pattern, (name, material) in zip(tile_patterns(file, sheets), parts, strict=True):
        for one in onto:
            if name in (None, one.name) and (material is None or material in one.labels):
                found.setdefault(pattern, []).append(same(bpy.data.objects, one.uid))
    return found


def refuse_anothers(files: Mapping[Path, Collection[Any]]) -> None:
    """Raises InputError where a result would be written over a texture or heights that were made for another object.

    Names that differ in a space or a dot alone become one in a file's name. What an object wears because it shares a
    material with the one that it was made for is not its own.

    files: what will be written (tiles by their name with <UDIM>, frames by their folder), and the objects it is for.
    """
    for image in (image for image in bpy.data.images if image.filepath):
        path = Path(bpy.path.abspath(image.filepath, library=image.library))
        targets = next((files[file] for file in files if _holds(file, path, image)), None)
        if targets is None:
            continue
        wearers = [obj for obj in bpy.data.objects if obj.users_scene and image in _images_on(obj)]
        made_for = json.loads(remembered(image, "onto") or "[]")
        owners = [obj for obj in wearers if obj.name in made_for] or wearers  # all, where it was renamed since
        if owners and not any(obj in owners for obj in targets):
            raise InputError(f'the result would overwrite {path}, which is for "{owners[0].name}"; choose another file')


def _holds(file: Path, path: Path, image: Any) -> bool:
    """Whether what will be written is an image's file, or the folder of its frames; "Oak" and "oak" are one on some
    systems."""
    tile = str(image.tiles[0].number) if image.source == "TILED" and image.tiles else "<UDIM>"
    one, other = (Path(str(name).replace("<UDIM>", tile)) for name in (file, path))
    if one in (other, other.parent):
        return True
    return one.exists() and any(there.exists() and one.samefile(there) for there in (other, other.parent))


def _images_on(obj: Any) -> Iterator[Any]:
    """What an object wears of bakes and displacements."""
    trees = [slot.material.node_tree for slot in obj.material_slots if slot.material and slot.material.node_tree]
    yield from (tree.nodes[name].image for tree in trees for name in (TEXTURE_NODE, HEIGHT_NODE) if name in tree.nodes)
    modifier = obj.modifiers.get(DISPLACE)
    if modifier and modifier.texture and modifier.texture.type == "IMAGE":
        yield modifier.texture.image
