"""The settings of what is made of the photo's normals beside the texture: heights, a mesh, pictures."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.defaults import FACES

from .declared import FILE_FORMATS, GIVEN, PATH


class HeightsSettings:
    """How the normals are integrated, and what is made of the heights."""

    method: EnumProperty(
        name="Surface",
        description="Whether the surface may break",
        items=[
            ("FAST", "Smooth", "One surface without gaps: for one object, reliefs, cloth"),
            ("BILATERAL", "With Steps", "It breaks where one thing stands before another. Takes several times as long"),
        ],
        default="FAST",
        options=GIVEN,
    )
    distance: FloatProperty(
        name="Distance",
        description="How far the object is from the camera, in the scene's unit. Perspective takes its scale from it. "
        "0: as far as the target is in this scene",
        default=0.0,
        min=0.0,
        options=GIVEN,
    )
    mesh: BoolProperty(
        name="Mesh", description="Make a mesh of it, where the photo's camera saw it", default=True, options=GIVEN
    )
    faces: IntProperty(
        name="Faces",
        description="How many faces the mesh may have; small ones where the surface bends",
        default=FACES,
        min=2,
        max=10_000_000,
        options=GIVEN,
    )
    curvature: BoolProperty(
        name="Curvature", description="Picture of edges, bright, and creases, dark", default=False, options=GIVEN
    )
    occlusion: BoolProperty(
        name="Ambient Occlusion", description="Picture of how open the surface is", default=False, options=GIVEN
    )
    relit: BoolProperty(
        name="Relit", description="Picture of the surface under a white light", default=False, options=GIVEN
    )
    file_format: EnumProperty(
        name="Format",
        description="File format of the heights. OpenEXR holds them in world units, the others from black to white",
        items=FILE_FORMATS,
        default="EXR",
        options=GIVEN,
    )
    output: StringProperty(
        name="Height File",
        description="File of heights to write; what else is made goes beside it. Empty: a name of its own in the "
        "output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class MPS_PG_heights(HeightsSettings, bpy.types.PropertyGroup):
    """The heights: their settings, and they themselves once they are there."""

    image: PointerProperty(name="Heights", description="Heights as the photo's camera sees them", type=bpy.types.Image)
