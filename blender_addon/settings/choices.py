"""The user's choices among the settings, carried over from one file to the next.

Choices that were changed since a file was opened are stored in the add-on's preferences. A scene in which nothing was
ever set starts with them. Files, names and measurements of a photo are not carried over.
"""

import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..image_records import from_json
from ..preferences import PACKAGE
from .declared import setting_names
from .scene import STEPS

_KINDS = {"BOOLEAN", "INT", "FLOAT", "ENUM"}
_OF_ONE_PHOTO = ("calibrate.circle", "calibrate.second", "material.crop", "material.width")

# The choices of each scene at the time its file was opened, by session UID.
_opened: dict[int, dict[str, Any]] = {}


def choice_names(group: Any) -> list[str]:
    """The names of a step's settings that are choices, in order: those that set others come first."""
    return [name for name in setting_names(group) if group.bl_rna.properties[name].type in _KINDS]


def choices(scene: Any) -> dict[str, Any]:
    """All choices of a scene as JSON data, by names such as "rig.slant"."""
    found = {}
    for step, group in _steps(scene):
        for name in choice_names(group):
            value = getattr(group, name)
            found[f"{step}.{name}"] = sorted(value) if isinstance(value, set) else value
    return {path: value for path, value in found.items() if not path.startswith(_OF_ONE_PHOTO)}


@persistent
def save_choices(*_: Any) -> None:
    """Store the choices that were changed since the file was opened in the preferences."""
    preferences, scene = _preferences(), bpy.context.scene
    if preferences is None or not preferences.remember or scene.session_uid not in _opened:
        return
    opened = _opened[scene.session_uid]
    changed = {path: value for path, value in choices(scene).items() if opened.get(path) != value}
    if changed:
        preferences.remembered = json.dumps({**from_json(preferences.remembered, dict), **changed})
        bpy.context.preferences.is_dirty = True  # otherwise Blender would not save them when it quits


@persistent
def restore_choices(*_: Any) -> None:
    """Apply the stored choices to scenes in which nothing was ever set."""
    preferences = _preferences()
    kept = from_json(preferences.remembered, dict) if preferences is not None and preferences.remember else {}
    _opened.clear()
    for scene in bpy.data.scenes:
        if not scene.library and not _is_any_set(scene.mps):
            for path, value in choices(scene).items():
                # Reset values that an earlier choice has set.
                _set(scene, path, kept.get(path, value))
        _opened[scene.session_uid] = choices(scene)


def _steps(scene: Any) -> Iterator[tuple[str, Any]]:
    for step in scene.mps.bl_rna.properties:
        if step.type == "POINTER" and step.identifier not in {"rna_type", "blank"}:
            yield step.identifier, getattr(scene.mps, step.identifier)
    for step in STEPS:
        yield step, getattr(scene.mps, step)


def _set(scene: Any, path: str, value: Any) -> None:
    step, _, name = path.partition(".")
    group, value = getattr(scene.mps, step), set(value) if isinstance(value, list) else value
    if getattr(group, name) != value:
        with suppress(TypeError, ValueError, OverflowError):  # stored by another version
            setattr(group, name, value)


def _is_any_set(group: Any) -> bool:
    """Whether anything in a group was ever set."""
    for one in group.bl_rna.properties:
        if one.identifier in {"rna_type", "way"}:  # the way counts as set even if nobody chose it
            continue
        value: Any = getattr(group, one.identifier)
        if one.type == "COLLECTION":
            found = any(map(_is_any_set, value))
        elif one.type == "POINTER":  # it counts as set from the start
            found = _is_any_set(value) if isinstance(value, bpy.types.PropertyGroup) else bool(value)
        else:
            found = group.is_property_set(one.identifier)
        if found:
            return True
    return False


def _preferences() -> Any:
    """The add-on's preferences; None if it runs as a plain module."""
    addon = bpy.context.preferences.addons.get(PACKAGE)
    return addon.preferences if addon is not None else None


# Without a window there are only scripts: they set their own values, and must not depend on the user's. exit_pre exists
# from Blender 5.1 on.
_LEAVING = dict.fromkeys(("load_pre", "save_pre", "exit_pre"), save_choices)
HANDLERS = {} if bpy.app.background else {**_LEAVING, "load_post": restore_choices}
TIMERS = (restore_choices,)


def register() -> None:
    if not bpy.app.background:
        bpy.app.timers.register(restore_choices, first_interval=0)  # for the file that is already open
