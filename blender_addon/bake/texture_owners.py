"""Owners of textures and heights: the objects they were made for. Results must not overwrite those of other objects."""

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from glob import escape
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from mpsnet_core.errors import FileError
from mpsnet_core.scene.texture_names import tile_patterns

from ..appearance.modifiers import DISPLACE, find_modifier
from ..appearance.nodes import ALBEDO_NODE, HEIGHT_NODE, TEXTURE_NODE, find_node, trees_of
from ..image_records import from_json, origin, remember, remembered
from ..provenance import written_in_this_session
from ..scene.objects import by_session_uid
from .texture_sets import TILE, AssignedTexture, BakeTarget, Part, parts_of

# Stands for the number in the names of a sequence's frames.
FRAME = "<FRAME>"


def store_owners(assigned: Sequence[AssignedTexture]) -> None:
    """Store the names of the meshes that each image was made for.

    Mesh names, because duplicates of an object have its textures, but usually their own mesh, and objects are renamed
    more often.
    """
    for image in {image for one in assigned for image in one.images}:
        remember(image, "onto", json.dumps(sorted({one.target.data.name for one in assigned if image in one.images})))


class _TextureName(NamedTuple):
    tile: int | None
    material: str | None
    object: str | None


def files_for(onto: Sequence[BakeTarget], file: Path) -> dict[Path, list[Any]]:
    """The files that the tokens in `file` expand to, except <UDIM>, with the objects of each."""
    parts = [part for part in parts_of(onto, file) if any(_has_faces(one, part) for one in onto)]
    tile = 1001 if TILE in file.name else None  # any number: the token stays
    texture_sets = [_TextureName(tile, material, name) for name, material in parts]
    found: dict[Path, list[Any]] = {}
    for pattern, part in zip(tile_patterns(file, texture_sets), parts, strict=True):
        found.setdefault(pattern, []).extend(
            by_session_uid(bpy.data.objects, one.uid) for one in onto if _has_faces(one, part)
        )
    return found


def _has_faces(onto: BakeTarget, part: Part) -> bool:
    name, material = part
    return name in (None, onto.name) and (material is None or material in onto.used)


def refuse_to_overwrite_other_objects(files: Mapping[Path, Collection[Any]]) -> None:
    """Raise InputError if a result would be written over a texture or heights that were made for another object.

    Object names that differ only in a space or a dot yield the same file name. Objects that share a mesh share its
    textures. A texture that an object has because it shares a material with the owner, or is its duplicate, is not its
    own.

    files: the files to write (tiles named with <UDIM>, frames with :data:`FRAME`), with their objects.
    """
    for image in (image for image in bpy.data.images if image.filepath):
        targets = next((files[file] for file in files if _is_file_of(file, image)), None)
        if targets is None:
            continue
        users = [obj for obj in _objects_in_use() if image in _images_on(obj)]
        its_own, meshes = any(_made_for(image, obj) for obj in targets), {obj.data for obj in targets}
        others = [obj for obj in users if _made_for(image, obj) and obj.data not in meshes]
        if not (its_own or others or any(obj.data in meshes for obj in users)):
            others = users  # the owners' meshes were renamed or replaced since
        if others:
            name = min(obj.name for obj in others)
            too, mend = (" too", "bake onto it as well, ") if its_own else ("", "")
            raise FileError(
                f'the result would overwrite {origin(image)}, which is for "{name}"{too}; {mend}choose another file, '
                f'or take it off "{name}" first'
            )


def refuse_other_projects(files: Iterable[Path]) -> None:
    """Raise InputError if a result would overwrite one that another .blend file in the folder may have made.

    That is a file that exists, was not written in this session, and is not used by any image of the open file.

    files: the files to write, named as for :func:`refuse_to_overwrite_other_objects`.
    """
    own = Path(bpy.data.filepath)
    for file in files:
        others = [other for other in sorted(file.parent.glob("*.blend")) if other.name != own.name]
        if not others or not any(file.parent.glob(escape(file.name).replace("<UDIM>", "[1-9]???"))):
            continue
        known = written_in_this_session(file) or any(
            image.filepath and _is_file_of(file, image) for image in bpy.data.images
        )
        if not known:
            raise FileError(
                f"{file} is there already, and no image of this file shows it: it may be that of {others[0].name}; "
                "choose another file, or delete it"
            )


def _made_for(image: Any, obj: Any) -> bool:
    return obj.data.name in from_json(remembered(image, "onto"), list) and obj.data.library == image.library


def _objects_in_use() -> set[Any]:
    """The objects in scenes and in instanced collections."""
    instanced = {obj.instance_collection for obj in bpy.data.objects} - {None}
    groups = [scene.objects for scene in bpy.data.scenes] + [collection.all_objects for collection in instanced]
    return {obj for objects in groups for obj in objects}


def _is_file_of(file: Path, image: Any) -> bool:
    """Whether a file to write is an image's file. "Oak" and "oak" are the same on some systems."""
    path = origin(image)
    tile = str(image.tiles[0].number) if image.source == "TILED" and image.tiles else "<UDIM>"
    number = re.findall("[0-9]*$", path.stem)[0]
    one, other = (each.with_name(each.name.replace("<UDIM>", tile)) for each in (file, path))
    one = one.with_name(one.name.replace(FRAME, number))
    return one == other or (one.exists() and other.exists() and one.samefile(other))


def _images_on(obj: Any) -> Iterator[Any]:
    """The images of bakes and displacements in an object's materials and modifiers."""
    trees = trees_of(obj)
    names = (TEXTURE_NODE, ALBEDO_NODE, HEIGHT_NODE)
    yield from (node.image for tree in trees for name in names if (node := find_node(tree, name)))
    modifier = find_modifier(obj, DISPLACE)
    if modifier and modifier.texture and modifier.texture.type == "IMAGE":
        yield modifier.texture.image
