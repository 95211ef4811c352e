"""Textures of a bake: their objects, file names and materials. Results must not overwrite those of other objects.

Tokens in the file name tell the core to split textures by UDIM tile, material or object.
"""

import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Any, NamedTuple

import bpy

from mpsnet_core.bake.operations import WrittenTexture
from mpsnet_core.errors import FileError, GeometryError
from mpsnet_core.scene.texture_names import tile_patterns

from ..appearance.modifiers import DISPLACE, find_modifier
from ..appearance.nodes import ALBEDO_NODE, HEIGHT_NODE, TEXTURE_NODE, image_in, trees_of, with_nodes
from ..image_records import from_json, origin, remember, remembered, written_in_this_session
from ..images import load_image, load_tiles
from ..scene.objects import by_session_uid

# Tokens in file names for each way to split textures.
OBJECT, MATERIAL, TILE = "<OBJECT>", "<MATERIAL>", "<UDIM>"
SPLITS = {"ONE": "", "MATERIAL": MATERIAL, "OBJECT": OBJECT}


# The object and the material of a texture, as in the core's result; None stands for all.
Part = tuple[str | None, str | None]
# Stands for the number in the names of a sequence's frames.
FRAME = "<FRAME>"


def with_tokens(path: Path, split: str, tiles: bool) -> Path:
    """The texture's file name with the missing tokens for textures that are split in this way."""
    name, token = path.stem, SPLITS[split]
    if token and token not in name:
        name += f"_{token}"
    if tiles and TILE not in name:
        name += f".{TILE}"
    return path.with_name(name + path.suffix)


def without_tokens(name: str) -> str:
    """The name without tokens and the separators before them."""
    return re.sub("[._-]?<[A-Z]+>", "", name).strip("._-")


@dataclass(frozen=True)
class BakeTarget:
    """An object that is baked onto, by IDs and names that stay valid whatever happens to the file meanwhile."""

    uid: int
    """Its session UID."""
    name: str
    """Its name when the bake began."""
    uv_map: str
    """The UV map that is baked onto."""
    labels: tuple[str, ...]
    """Of its slots, see :func:`.mesh_file.slot_labels`."""
    used: frozenset[str]
    """Labels of slots with faces."""


def parts_of(onto: Sequence[BakeTarget], file: Path) -> list[Part]:
    """The parts with separate textures, by the tokens in the file name."""
    by_object, by_material = OBJECT in file.name, MATERIAL in file.name
    parts = [(one.name if by_object else None, label if by_material else None) for one in onto for label in one.labels]
    return list(dict.fromkeys(parts))


@dataclass(frozen=True)
class AssignedTexture:
    """The textures of an object."""

    target: Any
    """The object."""
    images: tuple[Any, ...]
    """One for each of its material slots."""
    uv_map: str
    """The UV map that they are on."""

    def texture_at(self, slot: int) -> tuple[Any, str]:
        """The image and UV map of the material in a slot."""
        return self.images[min(slot, len(self.images) - 1)], self.uv_map


def load_textures(written: Sequence[WrittenTexture], name: str, what: str = "") -> dict[Part, Any]:
    """Load the textures of the core's result as images, by the names of their object and material.

    None stands for all; UDIM tiles are one image. what: "albedo" or "coverage" for those that go with the textures.
    """
    parts: dict[Part, list[WrittenTexture]] = {}
    for one in written:
        parts.setdefault((one.object, one.material), []).append(one)
    images = {}
    for part, textures in parts.items():
        file = getattr(textures[0], what or "output")
        if file is None:  # nothing of that kind goes with the textures
            continue
        named = " ".join(["MPS", *(filter(None, part) if any(part) else [name]), *([what.title()] if what else [])])
        numbers = [one.tile for one in textures if one.tile is not None]
        if numbers:
            pattern = Path(getattr(textures[0], f"{what}_tiles" if what else "tiles"))
            images[part] = load_tiles(pattern, numbers, named, is_data=not what)
        else:
            images[part] = load_image(Path(file), named, is_data=not what)
    return images


def texture_of(onto: BakeTarget, target: Any, images: Mapping[Part, Any]) -> AssignedTexture | None:
    """The textures of an object among the images; None if there is none for it."""
    found = [
        next((images[key] for key in images if key[0] in (None, onto.name) and key[1] in (None, label)), None)
        for label in onto.labels
    ]
    some = next((image for image in found if image is not None), None)
    return AssignedTexture(target, tuple(image or some for image in found), onto.uv_map) if some else None


def ensure_own_materials(assigned: Sequence[AssignedTexture]) -> dict[Any, tuple[Any, str]]:
    """The objects' materials, and the texture that each will get.

    Missing ones are created. Those that are linked from another file, or shared with objects that get another texture,
    are copied.
    """
    for one in assigned:
        _give_slot(one.target)
    textures = {_slot_owner(slot): one for one in assigned for slot in one.target.material_slots}
    copies: dict[tuple[Any, Any, str], Any] = {}
    materials: dict[Any, tuple[Any, str]] = {}
    for one in assigned:
        for number, slot in enumerate(one.target.material_slots):
            texture = one.texture_at(number)
            if slot.material is None:
                slot.material = bpy.data.materials.new(f"MPS {one.target.name}")
            elif (slot.material, *texture) in copies:
                slot.material = copies[slot.material, *texture]
            else:
                before = slot.material
                if before.library or _has_other_texture(before, texture, textures):
                    slot.material = before.copy()
                copies[before, *texture] = copies[slot.material, *texture] = slot.material
            materials[with_nodes(slot.material)] = texture
    return materials


def keep_materials_to_itself(target: Any) -> None:
    """Give an object whose mesh is shared its own material slots, so that other objects keep theirs."""
    _give_slot(target)
    slots = (slot for other in bpy.data.objects if other != target for slot in other.material_slots)
    if target.data in {_slot_owner(slot) for slot in slots}:
        for slot in target.material_slots:
            material, slot.link = slot.material, "OBJECT"
            slot.material = material


def _give_slot(target: Any) -> None:
    """Give an object without a material slot an empty one, and all others that share its mesh."""
    if not target.material_slots:
        target.data.materials.append(None)


def _slot_owner(slot: Any) -> Any:
    """The owner of a slot's material: the object, or the mesh, which several objects may share."""
    return slot.id_data if slot.link == "OBJECT" else slot.id_data.data


def _has_other_texture(material: Any, texture: tuple[Any, str], textures: Mapping[Any, AssignedTexture]) -> bool:
    return any(
        slot.material == material
        and (_slot_owner(slot) not in textures or textures[_slot_owner(slot)].texture_at(number) != texture)
        for other in bpy.data.objects
        for number, slot in enumerate(other.material_slots)
    )


def refuse_shared(targets: Sequence[Any], split: str) -> None:
    """Raise InputError for separate textures of objects that share a mesh: they share its materials, too."""
    if split != "OBJECT":
        return
    first: dict[Any, Any] = {}
    for target in targets:
        if first.setdefault(target.data, target) != target:
            raise GeometryError(
                f'"{first[target.data].name}" and "{target.name}" share one mesh and with it their materials; make '
                "them single-user (Object > Relations), or bake them into one texture"
            )


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
    names = (TEXTURE_NODE, ALBEDO_NODE, HEIGHT_NODE)
    yield from (image_in(tree, name) for tree in trees_of(obj) for name in names)
    modifier = find_modifier(obj, DISPLACE)
    if modifier and modifier.texture and modifier.texture.type == "IMAGE":
        yield modifier.texture.image
