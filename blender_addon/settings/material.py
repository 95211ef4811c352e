"""Settings of flat materials."""

import bpy
from bpy.props import StringProperty

from mpsnet_core.defaults import BY_PHOTO
from mpsnet_core.relief.operations import MakeMaterial

from .declared import EnumSetting, FloatSetting, IntSetting, from_option, identifier, image_pointer, object_pointer
from .estimate import MODEL_ITEMS

_AUTO = (
    identifier(BY_PHOTO),
    "Automatic",
    "Equation 2 where the photo shows a matt material, the default network where it shows a glossy one",
    10,
)


class MaterialSettings:
    """How a photo of a flat material becomes a seamless one."""

    width: FloatSetting(
        "Photo Width",
        "What the photo's whole width measures on the material, in this scene's unit. "
        "0: by the orthographic camera that the photo was rendered with",
        precision=4,
        subtype="DISTANCE",
        within=(0.0, 1e6),
    )
    crop_left: IntSetting("Left", "Pixels to leave out at the photo's left edge", min=0)
    crop_right: IntSetting("Right", "Pixels to leave out at the photo's right edge", min=0)
    crop_top: IntSetting("Top", "Pixels to leave out at the photo's top", min=0)
    crop_bottom: IntSetting("Bottom", "Pixels to leave out at the photo's bottom", min=0)
    model: from_option(MakeMaterial, "model", items=[*MODEL_ITEMS, _AUTO])
    size: from_option(MakeMaterial, "size")
    overlap: from_option(MakeMaterial, "overlap")
    bend: from_option(MakeMaterial, "bend", name="Flatten")
    grey: from_option(MakeMaterial, "grey", name="Grey Albedo")
    relief: EnumSetting(
        "Relief",
        "How the material shows its relief in Blender",
        items=[
            ("NORMAL", "Normal Map", "Light falls as on the relief; the surface itself stays flat"),
            (
                "DISPLACEMENT",
                "Displacement",
                "The surface itself is displaced by the true height in Cycles, and what is finer than its faces is "
                "a bump",
            ),
        ],
    )
    repeats: IntSetting(
        "Repeats", "How many tiles wide and high the plane is that shows the material", default=1, within=(1, 1000)
    )
    output: from_option(MakeMaterial, "output", name="Folder", unset="a folder of its own in the output folder")


class MPS_PG_material(MaterialSettings, bpy.types.PropertyGroup):
    """A flat material: its settings, and what shows it once it is there."""

    plane: object_pointer("Plane", "The plane that shows the material")
    image: image_pointer("Preview", "The material, repeated")
    summary: StringProperty(name="Made", description="Size, depth and seam of the material that was made")
