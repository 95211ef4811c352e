"""Settings of flat materials."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.defaults import BEND, OVERLAP

from .declared import GIVEN, PATH
from .estimate import MODELS


class MaterialSettings:
    """How a photo of something flat becomes a material that repeats."""

    width: FloatProperty(
        name="Photo Width",
        description="What the photo's whole width measures on the material, in this scene's unit. "
        "0: as the orthographic camera tells that the photo was rendered with",
        default=0.0,
        min=0.0,
        max=1e6,
        precision=4,
        subtype="DISTANCE",
        options=GIVEN,
    )
    crop_left: IntProperty(
        name="Left", description="Pixels to leave out at the photo's left edge", default=0, min=0, options=GIVEN
    )
    crop_right: IntProperty(
        name="Right", description="Pixels to leave out at the photo's right edge", default=0, min=0, options=GIVEN
    )
    crop_top: IntProperty(
        name="Top", description="Pixels to leave out at the photo's top", default=0, min=0, options=GIVEN
    )
    crop_bottom: IntProperty(
        name="Bottom", description="Pixels to leave out at the photo's bottom", default=0, min=0, options=GIVEN
    )
    model: EnumProperty(
        name="Model",
        description="What turns the photo into normals",
        items=[(identifier, entry.label, entry.title) for identifier, entry in MODELS.items()],
        default="LAMBERTIAN_GREY_WORLD",
        options=GIVEN,
    )
    size: IntProperty(
        name="Size",
        description="Width and height of the pictures in pixels. 0: the pixels that the photo has there",
        default=0,
        min=0,
        max=8192,
        options=GIVEN,
    )
    overlap: FloatProperty(
        name="Overlap",
        description="Fraction of the tile over which its borders are joined. More hides the seam better and leaves a "
        "smaller tile",
        default=OVERLAP,
        min=0.05,
        max=0.5,
        options=GIVEN,
    )
    bend: IntProperty(
        name="Flatten",
        description="How many half waves across the photo are taken out as bends of the material and uneven light. "
        "0: only the tilt of the photo",
        default=BEND,
        min=0,
        max=12,
        options=GIVEN,
    )
    grey: BoolProperty(
        name="Grey Albedo",
        description="An albedo without colour, where the lights' strengths are not known",
        default=False,
        options=GIVEN,
    )
    relief: EnumProperty(
        name="Relief",
        description="How the material shows its relief in Blender",
        items=[
            ("NORMAL", "Normal Map", "Light falls as on the relief; the surface itself stays flat"),
            (
                "DISPLACEMENT",
                "Displacement",
                "The surface itself is displaced by the true height in Cycles, and what is finer than its faces is "
                "a bump",
            ),
        ],
        default="NORMAL",
        options=GIVEN,
    )
    repeats: IntProperty(
        name="Repeats",
        description="How many tiles wide and high the plane is that shows the material",
        default=1,
        min=1,
        max=1000,
        options=GIVEN,
    )
    output: StringProperty(
        name="Folder",
        description="Folder for the pictures. Empty: a folder of its own in the output folder",
        subtype="DIR_PATH",
        options=PATH,
    )


class MPS_PG_material(MaterialSettings, bpy.types.PropertyGroup):
    """A flat material: its settings, and what shows it once it is there."""

    plane: PointerProperty(name="Plane", description="The plane that shows the material", type=bpy.types.Object)
    image: PointerProperty(name="Preview", description="The material, repeated", type=bpy.types.Image)
    told: StringProperty(name="Made", description="Size, depth and seam of the material that was made")
