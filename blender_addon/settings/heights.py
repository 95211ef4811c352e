"""Settings of the other products of the photo's normals: heights, a mesh, images."""

import bpy

from mpsnet_core.relief.operations import Integrate

from .declared import FileSetting, format_setting, from_option, image_pointer
from .messages import OWN_SENSE


class HeightsSettings:
    """How the normals are integrated, and the products of the heights."""

    method: from_option(Integrate, "method", name="Surface", labels={"fast": "Smooth", "bilateral": "With Steps"})
    distance: from_option(Integrate, "distance", unset="as far as the target is in this scene")
    mesh: from_option(Integrate, "mesh", switch=True, default=True, translation_context=OWN_SENSE)
    faces: from_option(Integrate, "faces")
    curvature: from_option(Integrate, "curvature", switch=True)
    occlusion: from_option(Integrate, "occlusion", name="Ambient Occlusion", switch=True)
    relit: from_option(Integrate, "relit", switch=True)
    file_format: format_setting(
        "File format of the heights. OpenEXR holds them in world units, the others from black to white", default="EXR"
    )
    output: FileSetting(
        "Height File",
        "File of heights to write; what else is made goes beside it. Empty: a name of its own in the output folder",
    )


class MPS_PG_heights(HeightsSettings, bpy.types.PropertyGroup):
    """The heights: their settings, and they themselves once they are there."""

    image: image_pointer("Heights", "Heights as the photo's camera sees them")
