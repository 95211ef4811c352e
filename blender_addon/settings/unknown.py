"""Invalid settings in a .blend file: it may be from a later version, or manipulated."""

from typing import Any

import bpy
from bpy.app.handlers import persistent


@persistent
def reset_invalid_settings(*_: Any) -> None:
    """Reset settings of the open file that could not be set in the panel to their defaults.

    Called when a file is opened or linked: code that reads a setting can rely on a valid value.
    """
    for image in bpy.data.images:
        _reset_invalid(image.mps)
    for scene in bpy.data.scenes:
        _reset_invalid(scene.mps)
        if scene.mps.chosen_rig >= max(len(scene.mps.rigs), 1):
            scene.mps.property_unset("chosen_rig")


def _reset_invalid(group: Any) -> None:
    for setting in group.bl_rna.properties:
        name = setting.identifier
        if setting.type == "COLLECTION":
            for item in getattr(group, name):
                _reset_invalid(item)
        elif setting.type == "POINTER":
            if name != "rna_type" and isinstance(inner := getattr(group, name), bpy.types.PropertyGroup):
                _reset_invalid(inner)
        elif group.is_property_set(name) and not _is_valid(group, setting):
            group.property_unset(name)


def _is_valid(group: Any, setting: Any) -> bool:
    try:
        value = getattr(group, setting.identifier)
    except UnicodeDecodeError:
        return False
    if setting.type == "ENUM":
        return setting.is_enum_flag or bool(value)  # "" if the file's number belongs to no item
    if setting.type in {"INT", "FLOAT"}:
        values = value if setting.is_array else [value]
        return all(setting.hard_min <= one <= setting.hard_max for one in values)  # False for NaN
    return True


HANDLERS = {"load_post": reset_invalid_settings, "blend_import_post": reset_invalid_settings}
