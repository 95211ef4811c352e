"""Whether a .blend file's scripts run: by the person's decision, never by what the file holds.

``bpy.app.autoexec_fail`` shows that Blender has blocked scripts; that it is off proves nothing, as drivers of what the
viewport hides do not count. Nothing that a file can hold counts as permission.
"""

import fnmatch
import os
import sys
from pathlib import Path
from typing import Any

import bpy

SCRIPTS_OFF = "scripts are off where this was rendered"

# In which scene the box is ticked, by its number in this session, which no file can name. Blender would keep a property
# of its own in the .blend file.
_ticked = 0


def preferences_trust(*paths: str) -> bool:
    """Whether the person's own preferences let scripts of these files run, each of them.

    Excluded paths are compared as Blender does it, by how a folder's name begins or by a pattern, and also where a link
    leads.
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
    """Whether the person has ticked, for the next run in this scene, that its file's scripts may run."""
    return bpy.context.scene is not None and bpy.context.scene.session_uid == _ticked


def tick(_: Any, ticked: bool) -> None:
    global _ticked
    _ticked = bpy.context.scene.session_uid if ticked else 0


def take_run_permission() -> bool:
    """Whether scripts may run in what is started now; the box is empty again afterwards."""
    ticked = is_ticked()
    tick(None, False)
    return ticked or open_file_is_trusted()


def python_drivers() -> list[str]:
    """A sentence where the open file has drivers that need Python, for a Blender that runs none whoever trusts it."""
    trees = (tree for one in bpy.data.user_map() if (tree := getattr(one, "node_tree", None)))
    for one in (*bpy.data.user_map(), *trees):
        animation = getattr(one, "animation_data", None)
        drivers = [curve.driver for curve in animation.drivers] if animation else []
        if any(driver.type == "SCRIPTED" and not driver.is_simple_expression for driver in drivers):
            return [f'{SCRIPTS_OFF}: drivers with Python, as "{one.name}" has, keep the values that they had here']
    return []


def blocked_scripts_note() -> list[str]:
    """A sentence where this Blender has blocked scripts of the open file, which a render then lacks."""
    if not bpy.app.autoexec_fail:
        return []
    return [
        f"{SCRIPTS_OFF}, and what drivers and text blocks of this file would do is not in it "
        f"({bpy.app.autoexec_fail_message}); if you trust the file, tick Run Scripts Once and render again"
    ]
