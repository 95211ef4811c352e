"""Whom a texture or heights were made for, so that no result goes over those of another object."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from mpsnet_core.errors import InputError
from mpsnet_core.surface.texture_names import tile_patterns

from .mesh_file import DISPLACE
from .nodes import HEIGHT_NODE, TEXTURE_NODE
from .operators import same
from .outputs import remember, remembered
from .present_map import parts_of
from .textures import TILE, Onto, Worn


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
