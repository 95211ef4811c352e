"""Blender's *Online Manual* (F1, right click) for the add-on's buttons and fields: opens pages of the reference.

The pages ship with the extension if it was built with them. Each entry of the reference has a redirect page, named
after Blender's identifier of the operator or property.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy

from .preferences import MPS_AddonPreferences

HERE = Path(__file__).parent
# In the extension, or built in a checkout.
FOLDERS = [HERE / "manual", HERE.parent / "docs" / "_build"]
PLACES = Path("reference", "at")


def operators() -> Iterator[tuple[str, Any]]:
    """Every operator of the add-on: its Python name and its RNA."""
    for name in sorted(dir(bpy.ops.mps)):
        yield f"bpy.ops.mps.{name}", getattr(bpy.ops.mps, name).get_rna_type()


def groups() -> Iterator[tuple[str, Any]]:
    """Every group of settings: the expression by which a script accesses it, and its RNA."""
    seen: set[str] = set()
    for owner in ("scene", "image", "window_manager"):
        kind = getattr(bpy.types, owner.title().replace("_", ""))
        group = kind.bl_rna.properties["mps"].fixed_type
        if owner == "scene":  # the chosen rig's are found there, too
            for one in group.properties["rigs"].fixed_type.properties:
                if one.type == "POINTER" and one.identifier != "rna_type":
                    yield from _within(f"scene.mps.{one.identifier}", one.fixed_type, seen)
        yield from _within(f"{owner}.mps", group, seen)
    yield "preferences", MPS_AddonPreferences.bl_rna


def _within(name: str, group: Any, seen: set[str]) -> Iterator[tuple[str, Any]]:
    if group.identifier in seen:
        return
    seen.add(group.identifier)
    yield name, group
    for one in group.properties:
        if one.type in {"POINTER", "COLLECTION"} and one.fixed_type.identifier.startswith("MPS_PG_"):
            yield from _within(f"{name}.{one.identifier}{'[0]' * (one.type == 'COLLECTION')}", one.fixed_type, seen)


def shown(rna: Any) -> Iterator[Any]:
    """The properties of an operator or a group that users or scripts set."""
    for one in rna.properties:
        if one.identifier not in {"rna_type", "name", "bl_idname"} and not one.is_hidden:
            yield one


def anchor(rna: Any, setting: str) -> str:
    """Blender's identifier of a setting in a group when it looks it up: "bpy.types.mps_pg_bake.size"."""
    return f"bpy.types.{rna.identifier}.{setting}".lower()


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """The manual map for Blender: the common prefix of all addresses, and the rest for each lower-case identifier."""
    places = next(folder / PLACES for folder in FOLDERS if (folder / PLACES).is_dir())
    names = [name for name, _ in operators()]
    names += [anchor(group, one.identifier) for _, group in groups() for one in shown(group)]
    # Windows opens files by their paths.
    begin = f"{places}{os.sep}" if sys.platform == "win32" else f"{places.as_uri()}/"
    return begin, tuple((name, f"{name}.html") for name in names)


def explanation(code: str) -> str:
    """The address of the entry that explains a message with this code; "" if the pages are not there."""
    pages = (folder / "how_to" / "symptoms.html" for folder in FOLDERS)
    return next((f"{page.as_uri()}#{code}" for page in pages if code and page.is_file()), "")


def register() -> None:
    if any((folder / PLACES).is_dir() for folder in FOLDERS):
        bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    with suppress(ValueError):  # it was not registered
        bpy.utils.unregister_manual_map(manual_map)
