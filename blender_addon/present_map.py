"""The normal map that an object wears already, for detail to go on top of, run after run of the same."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.errors import InputError

from .nodes import GREEN_NODE, TEXTURE_NODE
from .operators import same
from .outputs import image_file

# Kept with a baked image: what the object wore before it, and which way that one's green points.
_BASE, _BASE_CONVENTION = "mpsnet_base", "mpsnet_base_convention"
_BY_FILE = "choose the file of a present map"


@dataclass(frozen=True)
class PresentMap:
    """A normal map: the session number of its image, its file, and its convention, OPENGL or DIRECTX."""

    uid: int
    file: Path
    convention: str


def present_map(target: Any, uv_map: str) -> PresentMap:
    """The normal map that an object's materials wear; beneath one that was baked here, the one from before it.

    uv_map: the name of the UV map that is baked onto.

    Raises InputError where there is none, several, or one that detail cannot be laid onto.
    """
    layers = target.data.uv_layers
    rendered = next((layer.name for layer in layers if layer.active_render), uv_map)
    found = {_source(normal, uv_map, rendered) for normal in _normal_maps(target)}
    if not found:
        raise InputError(f'no material of "{target.name}" has a Normal Map node with a texture; {_BY_FILE}')
    if len(found) > 1:
        names = ", ".join(sorted(f'"{image.name}"' for image, _ in found))
        raise InputError(f'the materials of "{target.name}" have different normal maps ({names}); {_BY_FILE}')
    ((image, convention),) = found
    if image.is_dirty:
        raise InputError(f'the normal map "{image.name}" has changes that are not in its file; save it first')
    return PresentMap(image.session_uid, image_file(image, "normal map", _BY_FILE), convention)


def keep_base(image: Any, base: PresentMap | None) -> None:
    """Have a baked image remember what the object wore before it."""
    found = same(bpy.data.images, base.uid) if base is not None else None
    if base is not None and found is not None and found != image:
        image[_BASE], image[_BASE_CONVENTION] = found, base.convention


def base_to_keep(target: Any, uv_map: str) -> PresentMap | None:
    """:func:`present_map`, or None where there is none to be had."""
    with suppress(InputError):
        return present_map(target, uv_map)
    return None


def _normal_maps(target: Any) -> Iterator[Any]:
    """The Normal Map nodes that the shaders of an object's materials have their normals from; bumps may be between."""
    for slot in target.material_slots:
        tree = slot.material and slot.material.node_tree
        for shader in tree.nodes if tree else ():
            if not (shader.type.startswith("BSDF") and "Normal" in shader.inputs):
                continue
            node = _before(shader, "Normal")
            while node is not None and node.type == "BUMP":
                node = _before(node, "Normal")
            if node is not None and node.type == "NORMAL_MAP":
                yield node


def _source(normal: Any, uv_map: str, rendered: str) -> tuple[Any, str]:
    """The image and the convention that a Normal Map node has them of.

    rendered: the UV map that a node takes that names none.
    """
    convention = getattr(normal, "convention", "OPENGL")  # from Blender 5.2 on
    texture = _before(normal, "Color")
    if texture is not None and texture.name == GREEN_NODE:
        convention, texture = "DIRECTX", _before(texture, 0)
    if texture is None or texture.type != "TEX_IMAGE" or texture.image is None:
        raise InputError(f"the present normal map does not come straight from an image texture; {_BY_FILE}")
    for placed in (normal.uv_map or rendered, _placed_by(texture, rendered)):
        if placed != uv_map:
            raise InputError(f'the present normal map is on UV map "{placed}"; bake onto that one')
    if texture.name == TEXTURE_NODE:
        base = texture.image.get(_BASE)
        if base is None:
            raise InputError(f'the only normal map is "{texture.image.name}", which was baked here; {_BY_FILE}')
        return base, texture.image[_BASE_CONVENTION]
    if normal.space != "TANGENT":
        raise InputError(f'the present normal map "{texture.image.name}" is not in tangent space; {_BY_FILE}')
    strength = normal.inputs["Strength"]
    if strength.is_linked or strength.default_value != 1:
        raise InputError(f'the present normal map "{texture.image.name}" is not worn at strength 1; set it to 1')
    return texture.image, convention


def _placed_by(texture: Any, rendered: str) -> str:
    """The UV map that an image texture lies on. Raises InputError where it lies there otherwise than one to one."""
    end = texture.inputs["Vector"]
    before = _before(texture, "Vector")
    if before is not None and before.type == "MAPPING" and _moves_nothing(before):
        end, before = before.inputs["Vector"], _before(before, "Vector") or before
    if texture.projection == "FLAT":
        if before is None or (before.type == "TEX_COORD" and end.links[0].from_socket.name == "UV"):
            return rendered
        if before.type == "UVMAP":
            return str(before.uv_map or rendered)
    raise InputError(
        f'the present normal map "{texture.image.name}" does not lie straight on a UV map; link its texture to a UV '
        f"Map node, or {_BY_FILE}"
    )


def _moves_nothing(mapping: Any) -> bool:
    still = {"Location": 0, "Rotation": 0, "Scale": 1}
    ends = [(mapping.inputs[name], value) for name, value in still.items() if name in mapping.inputs]
    same_place = all(not end.is_linked and set(end.default_value) == {value} for end, value in ends)
    return same_place and mapping.vector_type != "NORMAL"


def _before(node: Any, socket: str | int) -> Any:
    """The node that is linked to an input, None where none is."""
    links = node.inputs[socket].links
    return links[0].from_node if links else None
