"""The file list of the panel's fields: filtered to what a field takes, in the folder where its file probably is."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, StringProperty

from mpsnet_core.io.files import HEIF_SUFFIXES, RAW_SUFFIXES

from ..image_records import origin

# What Blender's filter for images, which knows the other formats, leaves out.
_OTHER_PHOTOS = (*HEIF_SUFFIXES, *RAW_SUFFIXES)
# The suffixes that settings take which are no photos, by their names.
_SUFFIXES = {
    "rig_file": (".json", ".lp"),
    "model_file": (".onnx",),
    "cameras": (".json", ".xml", ".txt", ".bin", ".sfm"),
}
# Settings that are filled in together where as many files are chosen for the first one, in the order of their names.
_TOGETHER = {"first": ("first", "second", "third"), "ball": ("ball", "second_light", "third_light")}
_last: list[Path] = []  # the folder of the last file that was chosen


def start_folder(context: Any, present: str = "") -> str:
    """Where a list opens: beside the present file, the last one that was chosen, the photo, or the .blend file."""
    photo = context.scene.mps.photo.image
    beside = [Path(bpy.path.abspath(present)).parent] if present else []
    related = [*beside, *_last, *([origin(photo).parent] if photo else []), Path(bpy.path.abspath("//"))]
    folder = next((one for one in related if one.is_absolute() and one.is_dir()), None)
    return f"{folder}{os.sep}" if folder else ""


def remember_folder(file: str) -> None:
    """Let the next list open beside this file."""
    _last[:] = [Path(bpy.path.abspath(file)).parent]


class MPS_OT_choose_file(bpy.types.Operator):
    """Choose a file of the kind that this field takes. For the first of three lights you can select all three photos"""

    bl_label = "Choose File"
    bl_options = {"INTERNAL", "UNDO"}

    group: StringProperty(name="Group", description="Path of the settings in the scene", options={"SKIP_SAVE"})
    setting: StringProperty(name="Setting", description="Name of the setting to fill in", options={"SKIP_SAVE"})
    filepath: StringProperty(name="File", description="The file", subtype="FILE_PATH", options={"SKIP_SAVE"})
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    filter_glob: StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    filter_image: BoolProperty(options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: Any, event: Any) -> set[Any]:
        suffixes = _SUFFIXES.get(self.setting, _OTHER_PHOTOS)
        self.filter_glob = ";".join(f"*{suffix}" for suffix in suffixes)
        self.filter_image = suffixes is _OTHER_PHOTOS
        present = getattr(context.scene.path_resolve(self.group), self.setting)
        self.filepath = bpy.path.abspath(present) or start_folder(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: Any) -> set[Any]:
        remember_folder(self.filepath)
        relative = bpy.data.filepath and context.preferences.filepaths.use_relative_paths
        chosen = sorted(str(Path(self.directory, file.name)) for file in self.files)
        names = _TOGETHER.get(self.setting, ())
        pairs = zip(names, chosen, strict=True) if len(names) == len(chosen) > 1 else [(self.setting, self.filepath)]
        for name, file in pairs:
            with suppress(ValueError):  # on another drive than the .blend file
                file = bpy.path.relpath(file) if relative else file
            setattr(context.scene.path_resolve(self.group), name, file)
        return {"FINISHED"}
