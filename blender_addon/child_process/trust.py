"""Whether a .blend file's scripts may run: the user decides, never the content of the file.

``bpy.app.autoexec_fail`` shows that Blender has blocked scripts. If it is off, scripts may still have been blocked: it
ignores drivers of data that the viewport hides. Nothing in a file counts as permission.
"""

import fnmatch
import os
import sys
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.errors import Note

SCRIPTS_OFF = "scripts are off where this was rendered"

# Session UID, which a file cannot set, of the scene in which the box is ticked. A property of Blender would be saved in
# the .blend file.
_ticked = 0


def preferences_trust(*paths: str) -> bool:
    """Whether the user's preferences let the scripts of all these files run.

    Excluded paths are compared as in Blender, by prefix or pattern, and with links resolved, too.
    """
    preferences = bpy.context.preferences
    if not preferences.filepaths.use_scripts_auto_execute or {"-Y", "--disable-autoexec"} & set(sys.argv):
        return False
    files = [Path(bpy.path.abspath(path)) for path in paths if path]
    folders = {f"{file.parent}{os.sep}" for file in (*files, *(file.resolve() for file in files))}
    return not any(_excludes(excluded, folder) for excluded in preferences.autoexec_paths for folder in folders)


def _excludes(excluded: Any, folder: str) -> bool:
    if excluded.use_glob:
        return fnmatch.fnmatch(folder, excluded.path)
    return bool(excluded.path) and os.path.normcase(folder).startswith(os.path.normcase(excluded.path))


def open_file_is_trusted() -> bool:
    """Whether the preferences trust the open file and its libraries, and Blender has blocked none of its scripts."""
    files = (bpy.data.filepath, *(library.filepath for library in bpy.data.libraries))
    return not bpy.app.autoexec_fail and preferences_trust(*files)


def is_ticked(_: Any = None) -> bool:
    """Whether the user has allowed the file's scripts for the next run in this scene."""
    return bpy.context.scene is not None and bpy.context.scene.session_uid == _ticked


def tick(_: Any, ticked: bool) -> None:
    global _ticked
    _ticked = bpy.context.scene.session_uid if ticked else 0


def take_run_permission() -> bool:
    """Whether scripts may run in the run that is started now. Clears the box."""
    ticked = is_ticked()
    tick(None, False)
    return ticked or open_file_is_trusted()


def python_drivers() -> list[Note]:
    """A sentence if the open file has drivers that need Python, for a Blender process that never runs scripts."""
    trees = (tree for one in bpy.data.user_map() if (tree := getattr(one, "node_tree", None)))
    for one in (*bpy.data.user_map(), *trees):
        animation = getattr(one, "animation_data", None)
        drivers = [curve.driver for curve in animation.drivers] if animation else []
        if any(driver.type == "SCRIPTED" and not driver.is_simple_expression for driver in drivers):
            words = '%s: drivers with Python, as "%s" has, keep the values that they had here'
            return [Note(words, SCRIPTS_OFF, one.name, level="look")]
    return []


def blocked_scripts_note() -> list[Note]:
    """A sentence if this Blender has blocked scripts of the open file, which a render will lack."""
    if not bpy.app.autoexec_fail:
        return []
    words = (
        "%s, and what drivers and text blocks of this file would do is not in it (%s); if you trust the file, tick Run "
        "Scripts Once and render again"
    )
    return [Note(words, SCRIPTS_OFF, bpy.app.autoexec_fail_message, level="look")]
