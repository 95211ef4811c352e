"""Settings of a photo that is combined from three, each under one white light."""

import bpy

from mpsnet_core.capture.operations import Superpose

from .declared import FileSetting, InputSetting, from_option


class SuperposeSettings:
    """Three photos under one white light each, in the order of the rig's lights, and the combined photo."""

    first: InputSetting(
        "First Light",
        "Photo of the object at rest under the first white light alone, as a torch held to one side: the red channel",
    )
    second: InputSetting(
        "Second Light",
        "Photo of the same pose under the second white light alone, from another side: the green channel",
    )
    third: InputSetting(
        "Third Light", "Photo of the same pose under the third white light alone, from the third side: the blue channel"
    )
    encoding: from_option(Superpose, "encoding")
    output: FileSetting("File", "OpenEXR file to write. Empty: a name of its own in the output folder")


class MPS_PG_superpose(SuperposeSettings, bpy.types.PropertyGroup):
    """Three photos under one white light each."""
