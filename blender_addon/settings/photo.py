"""The photo's settings."""

import bpy
from bpy.props import PointerProperty, StringProperty

from .declared import BoolSetting, FileSetting, IntSetting


class PhotoSettings:
    """How the one photo is rendered."""

    width: IntSetting(name="Width", description="Width of the photo in pixels", default=1024, min=8, max=16384)
    height: IntSetting(name="Height", description="Height of the photo in pixels", default=1024, min=8, max=16384)
    samples: IntSetting(
        name="Samples",
        description="Cycles samples a pixel for each of the three lights: more take longer and give less noise",
        default=32,
        min=1,
        max=65536,
    )
    animation: BoolSetting(
        name="Animation",
        description="Take a photo of each frame of the scene, from its first to its last, into a folder. "
        "Lights and camera should move together if they move: those of the first frame count for all",
        default=False,
    )
    output: FileSetting(
        name="Photo File",
        description="OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder",
    )


class MPS_PG_photo(PhotoSettings, bpy.types.PropertyGroup):
    """The one photo: how it is rendered, and the image once it is there."""

    image: PointerProperty(name="Photo", description="The photo under red, green and blue light", type=bpy.types.Image)
    truth: StringProperty(name="True Normals", description="File of the true normals of the photo's view. Empty: none")
