"""Settings of flat materials."""

import bpy
from bpy.props import PointerProperty, StringProperty

from mpsnet_core.relief.operations import MakeMaterial

from .declared import EnumSetting, FloatSetting, IntSetting, from_option
from .estimate import MODEL_ITEMS


class MaterialSettings:
    """How a photo of a flat material becomes a seamless one."""

    width: FloatSetting(
        name="Photo Width",
        description="What the photo's whole width measures on the material, in this scene's unit. "
        "0: by the orthographic camera that the photo was rendered with",
        default=0.0,
        min=0.0,
        max=1e6,
        precision=4,
        subtype="DISTANCE",
    )
    crop_left: IntSetting(name="Left", description="Pixels to leave out at the photo's left edge", default=0, min=0)
    crop_right: IntSetting(name="Right", description="Pixels to leave out at the photo's right edge", default=0, min=0)
    crop_top: IntSetting(name="Top", description="Pixels to leave out at the photo's top", default=0, min=0)
    crop_bottom: IntSetting(name="Bottom", description="Pixels to leave out at the photo's bottom", default=0, min=0)
    model: from_option(MakeMaterial, "model", items=MODEL_ITEMS)
    size: from_option(MakeMaterial, "size")
    overlap: from_option(MakeMaterial, "overlap")
    bend: from_option(MakeMaterial, "bend", name="Flatten")
    grey: from_option(MakeMaterial, "grey", name="Grey Albedo")
    relief: EnumSetting(
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
    )
    repeats: IntSetting(
        name="Repeats",
        description="How many tiles wide and high the plane is that shows the material",
        default=1,
        min=1,
        max=1000,
    )
    output: from_option(MakeMaterial, "output", name="Folder", unset="a folder of its own in the output folder")


class MPS_PG_material(MaterialSettings, bpy.types.PropertyGroup):
    """A flat material: its settings, and what shows it once it is there."""

    plane: PointerProperty(name="Plane", description="The plane that shows the material", type=bpy.types.Object)
    image: PointerProperty(name="Preview", description="The material, repeated", type=bpy.types.Image)
    summary: StringProperty(name="Made", description="Size, depth and seam of the material that was made")
