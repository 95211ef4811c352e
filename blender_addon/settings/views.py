"""Settings of the bake of many views."""

import bpy
from bpy.props import StringProperty

from mpsnet_core.bake.operations import BakeViews

from .bake import cut_off, detail_only
from .declared import EnumSetting, from_option
from .messages import OWN_SENSE


class ViewsSettings:
    """Photos from all around with their cameras, and how they are baked into one texture."""

    cameras: from_option(BakeViews, "cameras", unset="this scene's cameras, each with its photo as background image")
    photos: from_option(BakeViews, "photos", unset="")
    white: from_option(BakeViews, "white", name="White Photos", unset="no albedo is baked")
    axes: EnumSetting(
        "Mesh Import",
        "How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet",
        items=[
            ("Y_UP", "Y Up", "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do by default"),
            ("AS_IS", "As It Is", "With forward Y and up Z, as Blender's importer of PLY does"),
        ],
    )
    lights_in: from_option(
        BakeViews, "lights_in", name="Lights", labels={"camera": "Go With the Camera", "world": "Stand Still"}
    )
    level: detail_only(default=True)
    level_scale: cut_off()
    keep: from_option(BakeViews, "keep", name="Keep Normals")
    write_report: from_option(BakeViews, "report", switch=True, default=True, translation_context=OWN_SENSE)


class MPS_PG_views(ViewsSettings, bpy.types.PropertyGroup):
    """Many views: their settings, and the report of the last bake."""

    report_file: StringProperty()
