"""Several textures of one bake: their objects, file names and materials.

Tokens in the file name tell the core to split textures by UDIM tile, material or object.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.bake.operations import WrittenTexture
from mpsnet_core.errors import GeometryError

from ..appearance.nodes import with_nodes
from ..images import load_image, load_tiles

# Tokens in file names for each way to split textures.
OBJECT, MATERIAL, TILE = "<OBJECT>", "<MATERIAL>", "<UDIM>"
SPLITS = {"ONE": "", "MATERIAL": MATERIAL, "OBJECT": OBJECT}


# The object and the material of a texture, as in the core's result; None stands for all.
Part = tuple[str | None, str | None]


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
