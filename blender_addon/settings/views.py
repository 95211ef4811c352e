"""Settings of the bake of many views."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from .declared import GIVEN, PATH


class ViewsSettings:
    """Photos from all around with their cameras, and how they become one texture."""

    cameras: StringProperty(
        name="Cameras",
        description="What a photogrammetry program wrote: a COLMAP folder, Metashape's .xml, Meshroom's .sfm. "
        "Empty: this scene's cameras, each with its photo as background image",
        subtype="FILE_PATH",
        options=PATH,
    )
    photos: StringProperty(
        name="Photos", description="Folder of the photos of these cameras", subtype="DIR_PATH", options=PATH
    )
    axes: EnumProperty(
        name="Mesh Import",
        description="How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet",
        items=[
            ("Y_UP", "Y Up", "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do unless told"),
            ("AS_IS", "As It Is", "With forward Y and up Z, as Blender's importer of PLY does"),
        ],
        default="Y_UP",
        options=GIVEN,
    )
    lights_in: EnumProperty(
        name="Lights",
        description="What the lights went with while the photos were taken",
        items=[
            ("CAMERA", "Go With the Camera", "The lights are fixed to the camera, or the object stood on a turntable"),
            ("WORLD", "Stand Still", "The camera went round; a rig file has directions along the mesh's axes"),
        ],
        default="CAMERA",
        options=GIVEN,
    )
    level: BoolProperty(
        name="Level",
        description="Take large shapes from the mesh and detail from the photos: seams between views vanish",
        default=True,
        options=GIVEN,
    )
    level_scale: FloatProperty(
        name="Detail Size",
        description="What is smaller than this fraction of the object's size is detail, and taken from the photos",
        default=0.03,
        min=0.01,
        max=0.5,
        precision=3,
        options=GIVEN,
    )
    keep: StringProperty(
        name="Keep Normals",
        description="Folder for each view's normals; the next run goes on from them. Empty: they are not kept",
        subtype="DIR_PATH",
        options=PATH,
    )
    write_report: BoolProperty(
        name="Report",
        description="Write a page beside the texture that shows which views cover what and how far they disagree",
        default=True,
        options=GIVEN,
    )


class MPS_PG_views(ViewsSettings, bpy.types.PropertyGroup):
    """Many views: their settings, and the report of the last bake."""

    report_file: StringProperty()
