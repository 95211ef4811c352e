"""A copy of the open file, for a Blender beside this one."""

from pathlib import Path

import bpy

from mpsnet_core.errors import FileError

from ..errors import operator_report


def save_copy(path: Path, *, compress: bool, mend: str) -> None:
    """Save the open file as it is to `path` too, without the preview: nobody sees it, and it takes longer to render
    than all else, the longer the heavier the scene.

    Raises InputError if the copy cannot be written. mend: what to do about that.
    """
    preferences = bpy.context.preferences
    changed, preview = preferences.is_dirty, preferences.filepaths.file_preview_type
    packing = bpy.data.use_autopack
    try:
        bpy.data.use_autopack = False  # it would pack what the open file uses, too, and fail where that is gone
        preferences.filepaths.file_preview_type = "NONE"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=compress)
    except RuntimeError as error:
        raise FileError(f"cannot write {path} ({operator_report(error)}); {mend}") from None
    finally:
        bpy.data.use_autopack = packing
        preferences.filepaths.file_preview_type = preview
        preferences.is_dirty = changed  # else Blender would save the preferences when it quits
