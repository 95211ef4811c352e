"""The normal map that an object wears already, for detail to go on top of, run after run of the same."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.errors import InputError

from .nodes import GREEN_NODE, TEXTURE_NODE
from .outputs import image_file

# Kept with a baked image: what the object wore before it, and which way that one's green points.
_BASE, _BASE_CONVENTION = "mpsnet_base", "mpsnet_base_convention"
_BY_FILE = "choose the file of a present map"


@dataclass(frozen=True)
class PresentMap:
    """A normal map: the name of its image, its file, and its convention, OPENGL or DIRECTX."""

    image: str
    file: Path
    convention: str


def present_map(target: Any, uv_map: str) -> PresentMap:
    """The normal map that an object's materials wear; beneath one that was baked here, the one from before it.

    uv_map: the name of the UV map that is baked onto.

    Raises InputError where there is none, several, or one that detail cannot be laid onto.
    """
    found = {(image, convention) for normal in _normal_maps(target) for image, convention in [_source(normal, uv_map)]}
    if not found:
        raise InputError(f'no material of "{target.name}" has a Normal Map node with a texture; {_BY_FILE}')
    if len(found) > 1:
        names = ", ".join(sorted(f'"{image.name}"' for image, _ in found))
        raise InputError(f'the materials of "{target.name}" have different normal maps ({names}); {_BY_FILE}')
    ((image, convention),) = found
    if image.is_dirty:
        raise InputError(f'the normal map "{image.name}" has changes that are not in its file; save it first')
    return PresentMap(image.name, image_file(image, "normal map", _BY_FILE), convention)


def keep_base(image: Any, base: PresentMap | None) -> None:
    """Have a baked image remember what the object wore before it."""
    found = bpy.data.images.get(base.image) if base is not None else None
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


def _source(normal: Any, uv_map: str) -> tuple[Any, str]:
    """The image and the convention that a Normal Map node has them of."""
    convention = getattr(normal, "convention", "OPENGL")  # from Blender 5.2 on
    texture = _before(normal, "Color")
    if texture is not None and texture.name == GREEN_NODE:
        convention, texture = "DIRECTX", _before(texture, 0)
    if texture is None or texture.type != "TEX_IMAGE" or texture.image is None:
        raise InputError(f"the present normal map does not come straight from an image texture; {_BY_FILE}")
    if normal.uv_map not in ("", uv_map):
        raise InputError(f'the present normal map is on UV map "{normal.uv_map}"; bake onto that one')
    if texture.name == TEXTURE_NODE:
        base = texture.image.get(_BASE)
        if base is None:
            raise InputError(f'the only normal map is "{texture.image.name}", which was baked here; {_BY_FILE}')
        return base, texture.image[_BASE_CONVENTION]
    if normal.space != "TANGENT":
        raise InputError(f'the present normal map "{texture.image.name}" is not in tangent space; {_BY_FILE}')
    return texture.image, convention


def _before(node: Any, socket: str | int) -> Any:
    """The node that is linked to an input, None where none is."""
    links = node.inputs[socket].links
    return links[0].from_node if links else None
