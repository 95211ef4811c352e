"""Preferences of the add-on: what belongs to the machine rather than to a scene."""

import os
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

from mpsnet_core.errors import SettingsError
from mpsnet_core.synthesis.farm.address import is_loopback

# The add-on's name in Blender, and in the Blender processes that it starts.
PACKAGE = __package__ or ""


class MPS_AddonPreferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    provider: EnumProperty(
        name="Compute On",
        description="What networks run on. The Lambertian baseline always runs on the CPU",
        items=[
            ("CPU", "CPU", "Works everywhere"),
            ("CUDA", "CUDA", "NVIDIA graphics cards, where the installed onnxruntime has it"),
            ("DIRECTML", "DirectML", "Graphics cards on Windows, where the installed onnxruntime has it"),
            ("COREML", "Core ML", "Apple computers, where the installed onnxruntime has it"),
        ],
        default="CPU",
    )
    threads: IntProperty(
        name="Threads", description="CPU threads for networks. 0: all there are", default=0, min=0, max=1024
    )
    output_folder: StringProperty(
        name="Output Folder",
        description="Where photos, normal maps and textures go. Empty: beside the saved .blend file, "
        "else Blender's temporary folder",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    remember: BoolProperty(
        name="Remember Settings",
        description="What you change in the steps' settings is what the next new file begins with, files and names "
        "apart",
        default=True,
    )
    remembered: StringProperty(options={"HIDDEN"})  # JSON, see settings/choices.py

    training: BoolProperty(
        name="Training Data",
        description='Show the tab "MPS Training" in the sidebar of the 3D viewport, which renders training data',
    )
    cluster: StringProperty(
        name="Cluster",
        description="Address of a Dask scheduler whose machines render training data, such as tls://host:8786. "
        "Empty: this machine",
    )
    cluster_trusted: BoolProperty(
        name="Trusted Network",
        description="The cluster's address need not be tls://. Whoever is in its network may run code on this machine",
    )

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(self, "provider")
        column.prop(self, "threads")
        column.prop(self, "output_folder", placeholder="Beside the .blend File")
        column.prop(self, "remember")
        column.prop(self, "training")
        column = column.column()
        column.active = self.training
        column.prop(self, "cluster", placeholder="This Machine")
        row = column.row()
        row.active = bool(self.cluster) and not is_loopback(self.cluster)
        row.prop(self, "cluster_trusted")
        row = self.layout.row()
        row.enabled = output_folder().is_dir()
        row.operator("wm.path_open", text="Open Output Folder", icon="FILE_FOLDER").filepath = str(output_folder())


def preference(name: str) -> Any:
    """A preference, or its default if the add-on runs as a plain module.

    The environment overrides the output folder and the threads, as a farm has no preferences of its own. Raises
    SettingsError if it holds no number of threads.
    """
    given = os.environ.get(f"MPSNET_{name.upper()}", "") if name in {"output_folder", "threads"} else ""
    if given and name == "threads":
        if not given.isdecimal():
            raise SettingsError(f"MPSNET_THREADS is {given!r}, which is no number; set it to one, or to nothing")
        return int(given)
    if given:
        return given
    addon = bpy.context.preferences.addons.get(PACKAGE)
    if addon is not None and addon.preferences is not None:
        return getattr(addon.preferences, name)
    return MPS_AddonPreferences.bl_rna.properties[name].default


def output_folder() -> Path:
    """The folder from the preferences, else that of the saved .blend file, else Blender's temporary folder.

    "//" is no folder in a file that was never saved.
    """
    chosen = preference("output_folder")
    if chosen and (bpy.data.filepath or not chosen.startswith("//")):
        return Path(bpy.path.abspath(chosen))
    return Path(bpy.data.filepath).parent if bpy.data.filepath else Path(bpy.app.tempdir)
