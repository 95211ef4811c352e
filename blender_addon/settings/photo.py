"""The photo's settings."""

import bpy
from bpy.props import StringProperty

from .declared import BoolSetting, FileSetting, IntSetting, image_pointer


class PhotoSettings:
    """How the one photo is rendered."""

    width: IntSetting("Width", "Width of the photo in pixels", default=1024, within=(8, 16384))
    height: IntSetting("Height", "Height of the photo in pixels", default=1024, within=(8, 16384))
    samples: IntSetting(
        "Samples",
        "Cycles samples a pixel for each of the three lights: more take longer and give less noise",
        default=32,
        within=(1, 65536),
    )
    animation: BoolSetting(
        "Animation",
        "Take a photo of each frame of the scene, from its first to its last, into a folder. "
        "Lights and camera should move together if they move: those of the first frame count for all",
    )
    output: FileSetting(
        "Photo File", "OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder"
    )


class MPS_PG_photo(PhotoSettings, bpy.types.PropertyGroup):
    """The one photo: how it is rendered, and the image once it is there."""

    image: image_pointer("Photo", "The photo under red, green and blue light")
    truth: StringProperty(name="True Normals", description="File of the true normals of the photo's view. Empty: none")
