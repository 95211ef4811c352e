"""Base maps: the normal maps that objects have already, which detail is added to. Repeated bakes use the same ones."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.bake.map_list import ListedMap
from mpsnet_core.errors import InputError

from ..appearance.nodes import GREEN_NODE, NORMAL_NODE, OBJECT_NORMAL_NODE, TEXTURE_NODE, find_node
from ..appearance.shader_graph import End, Shader, before, node_before, shaders_of, uses_nodes
from ..images import image_file, refuse_unsaved, tile_files
from ..scene.objects import by_session_uid
from .texture_sets import TILE, BakeTarget, Part, parts_of

# Stored with a baked image: the object's previous normal map, and the convention of its green channel.
_BASE, _BASE_CONVENTION = "mpsnet_base", "mpsnet_base_convention"
_BY_FILE = "choose the file of an existing map"


@dataclass(frozen=True)
class AssignedMap:
    """A normal map of a material."""

    uid: int
    """Session UID of its image."""
    convention: str
    """OPENGL or DIRECTX."""


def store_base_map(image: Any, base: AssignedMap | None) -> None:
    """Store the object's previous normal map with a baked image; None for none."""
    if base is None:
        for key in {_BASE, _BASE_CONVENTION} & set(image.keys()):
            del image[key]
        return
    found = by_session_uid(bpy.data.images, base.uid)
    if found is not None and found != image:
        image[_BASE], image[_BASE_CONVENTION] = found, base.convention


def maps_before_bake(targets: Sequence[Any], onto: Sequence[BakeTarget], file: Path) -> dict[Part, AssignedMap | None]:
    """Each part's map; if it was baked here, the one that it replaced. None for those without one.

    Parts with a map that detail cannot be added to are left out.
    """
    bases: dict[Part, AssignedMap | None] = {}
    for part in parts_of(onto, file):
        with suppress(InputError):
            found = _assigned_map(targets, onto, part)
            bases[part] = None if found is None else AssignedMap(found[0].session_uid, found[1])
    return bases


def base_map_files(targets: Sequence[Any], onto: Sequence[BakeTarget], file: Path) -> list[ListedMap]:
    """The base map of each part's texture, with its file. The core reports the parts without one.

    Raises InputError if no part has one, or a part has several, or one that detail cannot be added to.
    """
    listed = []
    for part, image, convention in _usable_maps(targets, onto, file):
        read = tile_files if image.source == "TILED" else image_file
        green: Any = convention.lower()
        listed.append(ListedMap(read(image, "normal map", _BY_FILE), *part, green))
    return listed


def usable_maps(targets: Sequence[Any], onto: Sequence[BakeTarget], file: Path) -> list[Any]:
    """The images that :func:`base_map_files` would read, whether or not they have a file.

    Raises InputError as that function does, except for missing files.
    """
    return [image for _, image, _ in _usable_maps(targets, onto, file)]


def _usable_maps(targets: Sequence[Any], onto: Sequence[BakeTarget], file: Path) -> list[tuple[Part, Any, str]]:
    found = []
    for part in parts_of(onto, file):
        assigned = _assigned_map(targets, onto, part)
        if assigned is None:
            continue
        image, convention = assigned
        refuse_unsaved(image, "normal map")
        if image.source == "TILED" and TILE not in file.name:
            raise InputError(f'the existing normal map "{image.name}" has UDIM tiles; switch UDIM Tiles on')
        found.append((part, image, convention))
    if not found:
        whose = f'"{targets[0].name}"' if len(targets) == 1 else "the selected objects"
        raise InputError(f"no material of {whose} has a Normal Map node with a texture; {_BY_FILE}")
    return found


def _assigned_map(targets: Sequence[Any], onto: Sequence[BakeTarget], part: Part) -> tuple[Any, str] | None:
    """The normal map of a part of some objects, an image, and its convention; None if there is none.

    If it was baked here, it is the one that it replaced. onto: the same objects, with the UV maps that are baked onto.
    """
    found: dict[tuple[Any, str], str] = {}
    for target, one in zip(targets, onto, strict=True):
        layers = target.data.uv_layers
        rendered = next((layer.name for layer in layers if layer.active_render), one.uv_map)
        for material in _materials(target, one, part):
            for colour in _normal_maps(material):
                found.setdefault(_source(colour, one.uv_map, rendered), target.name)
    if not found:
        for target, one in zip(targets, onto, strict=True):
            for material in _materials(target, one, part):
                _refuse_coats(material)
        return None
    if len(found) > 1:
        names = ", ".join(sorted(f'"{image.name}"' for image, _ in found))
        several = f'the materials of "{next(iter(found.values()))}" have'
        if len(set(found.values())) > 1:
            several = "what shares one texture has"
        raise InputError(
            f"{several} different normal maps ({names}); set Textures to By Material or By Object, or {_BY_FILE}"
        )
    return next(iter(found))


def _materials(target: Any, onto: BakeTarget, part: Part) -> Iterator[Any]:
    """The materials of a part of an object that are rendered by their nodes."""
    obj, wanted = part
    for slot, label in zip(target.material_slots, onto.labels, strict=False):
        if obj in (None, onto.name) and wanted in (None, label) and slot.material and uses_nodes(slot.material):
            yield slot.material


def _normal_maps(material: Any) -> list[End]:
    """The Color inputs of the Normal Map nodes of the shaders that the render shows, possibly through Bump nodes.

    If the shaders have none, a baked one with its texture counts: a displacement has unlinked it, or replaced it by the
    same normals in object space.
    """
    found = [end for shader in shaders_of(material) if (end := _normal_map(shader, "Normal"))]
    displaced = find_node(material.node_tree, OBJECT_NORMAL_NODE)
    found = [end for end in found if end.socket.node != displaced]
    baked = find_node(material.node_tree, NORMAL_NODE)
    taken_off = [End(baked.inputs["Color"])] if baked is not None and baked.inputs["Color"].is_linked else []
    return found or taken_off


def _normal_map(shader: Shader, name: str) -> End | None:
    """The Color input of the Normal Map node before a shader's input of that name, None if there is none."""
    end = shader.end(name)
    while end is not None:
        node, groups = node_before(end)
        if node is None or node.type != "BUMP":
            is_map = node is not None and node.type == "NORMAL_MAP"
            return End(node.inputs["Color"], groups) if is_map else None
        end = End(node.inputs["Normal"], groups)
    return None


def _refuse_coats(material: Any) -> None:
    """Raise InputError if a normal map of a material is linked to some other input than Normal."""
    for shader in shaders_of(material):
        for name in (socket.name for socket in shader.node.inputs if socket.name.endswith(" Normal")):
            if _normal_map(shader, name) is not None:
                raise InputError(
                    f'the normal map of "{shader.node.name}" in material "{material.name}" is linked to {name} alone; '
                    f"link it to Normal, or {_BY_FILE}"
                )


def _source(colour: End, uv_map: str, rendered: str) -> tuple[Any, str]:
    """The image and the convention of a Normal Map node, by its Color input.

    rendered: the UV map of nodes that name none.
    """
    normal = colour.socket.node
    convention = getattr(normal, "convention", "OPENGL")  # from Blender 5.2 on
    texture, groups = node_before(colour)
    if texture is not None and texture == find_node(texture.id_data, GREEN_NODE):
        convention = "DIRECTX"
        texture, groups = node_before(End(texture.inputs[0], groups))
    if texture is None or texture.type != "TEX_IMAGE" or texture.image is None:
        raise InputError(f"the existing normal map does not come straight from an image texture; {_BY_FILE}")
    for placed in (normal.uv_map or rendered, _uv_map_of_texture(End(texture.inputs["Vector"], groups), rendered)):
        if placed != uv_map:
            raise InputError(f'the existing normal map is on UV map "{placed}"; bake onto that one')
    if texture.name == TEXTURE_NODE:
        base = texture.image.get(_BASE)
        if not isinstance(base, bpy.types.Image):
            raise InputError(f'the only normal map is "{texture.image.name}", which was baked here; {_BY_FILE}')
        return base, "DIRECTX" if texture.image.get(_BASE_CONVENTION) == "DIRECTX" else "OPENGL"
    if "sRGB" in (space := texture.image.colorspace_settings.name):
        raise InputError(
            f'the existing normal map "{texture.image.name}" is read in the colour space {space}, which bends its '
            "normals; set it to Non-Color"
        )
    if normal.space != "TANGENT":
        raise InputError(f'the existing normal map "{texture.image.name}" is not in tangent space; {_BY_FILE}')
    if _value(colour.input("Strength")) != 1:
        raise InputError(f'the existing normal map "{texture.image.name}" is not used at strength 1; set it to 1')
    return texture.image, convention


def _value(end: End) -> Any:
    """The value of an input that is linked to no node, else None."""
    output, last = before(end)
    return last.socket.default_value if output is None else None


def _uv_map_of_texture(end: End, rendered: str) -> str:
    """The UV map of an image texture, by its Vector input. Raises InputError if the texture is transformed on it."""
    texture = end.socket.node
    output, _ = before(end)
    if output is not None and output.node.type == "MAPPING":
        mapping = End(output.node.inputs["Vector"], node_before(end)[1])
        if _is_identity(mapping):
            output = before(mapping)[0] or output
    node = None if output is None else output.node
    if texture.projection == "FLAT":
        if node is None or (node.type == "TEX_COORD" and output.name == "UV"):
            return rendered
        if node.type == "UVMAP":
            return str(node.uv_map or rendered)
    raise InputError(
        f'the existing normal map "{texture.image.name}" does not lie straight on a UV map; link its texture to a UV '
        f"Map node, or {_BY_FILE}"
    )


def _is_identity(vector: End) -> bool:
    """Whether a Mapping node, by its Vector input, moves nothing."""
    mapping = vector.socket.node
    still = {"Location": 0, "Rotation": 0, "Scale": 1}
    values = [(_value(vector.input(name)), value) for name, value in still.items() if name in mapping.inputs]
    return mapping.vector_type != "NORMAL" and all(
        found is not None and set(found) == {value} for found, value in values
    )
