"""A copy of the open file for another Blender, and whether it finds the data that a scene uses from outside the file.

The open file has in memory what a copy must read again: libraries may have been moved or deleted since. A photo without
their data would look correct.
"""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.errors import FileError, Note

from ..errors import operator_errors
from ..scene.objects import temporarily, view_layer

# --- libraries --------------------------------------------------------------------------------------------------------


def missing_links() -> list[str]:
    """The linked data of the open file that was not found when it was opened, by type and full name."""
    return sorted(_key(one) for one in bpy.data.user_map() if one.is_missing)


def refuse_lost_links(scene: Any, before: list[str]) -> None:
    """Raise InputError if the scene's photo uses linked data that is missing here and was not `before`."""
    lost = [one for one in _used(scene) if one.is_missing and one.library and _key(one) not in before]
    for one in sorted(lost, key=_key):
        library = Path(bpy.path.abspath(one.library.filepath, library=one.library.library)).resolve()
        if library.is_file():
            raise FileError(
                f'"{one.name}" is no longer in the library {library}, from which this scene takes it; put it back, or '
                "make it local"
            )
        raise FileError(
            f'the library {library}, from which this scene takes "{one.name}", was not found; put it back, find it '
            "with File > External Data > Find Missing Files, or make its objects local"
        )


def _key(one: bpy.types.ID) -> str:
    return f"{one.id_type} {one.name_full}"


def _used(scene: Any) -> set[Any]:
    """All data that a photo of the scene may show: the view layer's rendered objects, and everything they use."""
    uses = defaultdict(set)
    for one, users in bpy.data.user_map().items():
        for user in users:
            uses[user].add(one)
    found: set[Any] = set()
    new = {*_shown(view_layer(scene).layer_collection), *(light.object for light in scene.mps.rig.lights)}
    while new := new - found - {None}:
        found |= new
        new = {one for user in new for one in uses[user]}
    return found


def _shown(layer: Any) -> Iterator[Any]:
    """Objects of a view layer that its render shows, and missing linked collections."""
    if layer.collection.hide_render:
        return
    if not layer.exclude:
        if layer.collection.is_missing:
            yield layer.collection
        yield from (obj for obj in layer.collection.objects if not obj.hide_render)
    for child in layer.children:
        yield from _shown(child)


# --- single files -----------------------------------------------------------------------------------------------------


def is_gone(one: Any) -> bool:
    """Whether the file of an image, a font, a volume or a cache is neither on disk nor packed."""
    if not one.filepath or one.filepath == "<builtin>" or getattr(one, "packed_file", None):
        return False
    return not Path(bpy.path.abspath(one.filepath, library=one.library)).is_file()


def not_found(scene: Any) -> list[Note]:
    """A sentence if files that a photo of the scene may show are missing; otherwise nothing."""
    kinds = (bpy.types.Image, bpy.types.VectorFont, bpy.types.Volume, bpy.types.CacheFile)
    gone = (one for one in _used(scene) if isinstance(one, kinds) and is_gone(one))
    single = [
        one for one in gone if getattr(one, "source", "FILE") == "FILE" and not getattr(one, "is_sequence", False)
    ]
    names = sorted({Path(bpy.path.abspath(one.filepath)).name for one in single})
    words = "not found, and what they bring may be missing from the render: %s"
    return [Note(words, ", ".join(names), level="look")] if names else []


# --- bakes of geometry nodes ------------------------------------------------------------------------------------------


# A folder that the user chose for a modifier's bakes: the names of object and modifier, the index in the modifier's
# list of bakes (-1 for all of them), and the absolute path.
BakeFolder = tuple[str, str, int, str]


def bake_folders(besides: Path) -> list[BakeFolder]:
    """The folders that the open file refers to by relative paths, except those in `besides`."""
    found = []
    for obj in bpy.data.objects:
        if obj.library is not None:
            continue
        for modifier in obj.modifiers:
            for number, (one, name) in _folder_owners(modifier).items():
                place = Path(bpy.path.abspath(getattr(one, name)))
                if getattr(one, name).startswith("//") and not place.is_relative_to(besides):
                    found.append((obj.name, modifier.name, number, str(place)))
    return found


def name_bake_folders(folders: list[BakeFolder]) -> bool:
    """Set the folders in a copy of the file to the paths where they were found. Returns whether any changed.

    Blender 4.5 does not adapt relative paths when it saves to another folder, and ignores changes after its first look.
    """
    changed = False
    for owner, modifier, number, place in folders:
        one, name = _folder_owners(bpy.data.objects[owner].modifiers[modifier])[number]
        if Path(bpy.path.abspath(getattr(one, name))).resolve() != Path(place).resolve():
            setattr(one, name, place)
            changed = True
    return changed


def _folder_owners(modifier: Any) -> dict[int, tuple[Any, str]]:
    """The owners of folder properties by index, with the property's name."""
    if modifier.type != "NODES":
        return {}
    own = {number: (bake, "directory") for number, bake in enumerate(modifier.bakes) if bake.use_custom_path}
    return {-1: (modifier, "bake_directory"), **own}


def save_copy(path: Path, *, compress: bool, mend: str) -> None:
    """Save a copy of the open file to `path`, without its preview, which takes longer to render than all the rest.

    Raises InputError if the copy cannot be written. mend: advice in its message.
    """
    preferences = bpy.context.preferences
    changed, preview = preferences.is_dirty, (preferences.filepaths, "file_preview_type", "NONE")
    # Packing would also pack files in the open file, and fail if one is missing.
    try:
        with temporarily((bpy.data, "use_autopack", False), preview), operator_errors(f"cannot write {path}", mend):
            bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=compress)
    finally:
        preferences.is_dirty = changed  # otherwise Blender would save the preferences when it quits
