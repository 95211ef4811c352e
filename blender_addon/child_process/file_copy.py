"""A copy of the open file, for another Blender process."""

from pathlib import Path

import bpy

from mpsnet_core.errors import FileError

from ..errors import operator_report


def save_copy(path: Path, *, compress: bool, mend: str) -> None:
    """Save a copy of the open file to `path`, without its preview, which takes longer to render than all the rest.

    Raises InputError if the copy cannot be written. mend: advice in its message.
    """
    preferences = bpy.context.preferences
    changed, preview = preferences.is_dirty, preferences.filepaths.file_preview_type
    packing = bpy.data.use_autopack
    try:
        bpy.data.use_autopack = False  # it would also pack files in the open file, and fail if one is missing
        preferences.filepaths.file_preview_type = "NONE"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=compress)
    except RuntimeError as error:
        raise FileError(f"cannot write {path} ({operator_report(error)}); {mend}") from None
    finally:
        bpy.data.use_autopack = packing
        preferences.filepaths.file_preview_type = preview
        preferences.is_dirty = changed  # otherwise Blender would save the preferences when it quits
