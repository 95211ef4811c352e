"""The displacement's settings."""

import bpy
from bpy.props import PointerProperty

from mpsnet_core.relief.operations import Integrate

from .declared import BoolSetting, EnumSetting, FileSetting, IntSetting, format_setting, from_option


class DisplaceSettings:
    """What the baked texture's heights are and how the object wears them."""

    method: EnumSetting(
        name="Displace By",
        description="What moves the surface",
        items=[
            (
                "MATERIAL",
                "Material",
                "A Displacement node: when rendering. What is finer than the mesh becomes bumps, so that all detail "
                "is there",
            ),
            (
                "MODIFIER",
                "Modifier",
                "A Displace modifier: a mesh that can be seen in the viewport, sculpted and exported. What is finer "
                "than the mesh is lost",
            ),
        ],
        default="MATERIAL",
    )
    levels: IntSetting(
        name="Subdivisions",
        description="How often the mesh is subdivided first: each makes four times as many faces. "
        "0: it is fine enough as it is",
        default=4,
        min=0,
        max=8,
    )
    subdivision: EnumSetting(
        name="Subdivide",
        description="How the mesh is subdivided",
        items=[
            ("SIMPLE", "Simple", "The mesh keeps its shape: comes closest to what the photo shows"),
            ("CATMULL_CLARK", "Catmull-Clark", "The mesh becomes round: for one that is made for it"),
        ],
        default="SIMPLE",
    )
    # The core's default keeps all, for any normals; here they are estimated, which err most in broad shapes.
    scale: from_option(Integrate, "scale", name="Broadest", default=0.5)
    keep_normals: BoolSetting(
        name="Normal Map Too",
        description="Leave the normal map on. In tangent space it shows the same relief a second time, "
        "so it is taken off unless this is chosen. One in object space always stays: it does not",
        default=False,
    )
    file_format: format_setting(
        "File format of the heights. OpenEXR holds them in world units, the others from black to white", default="EXR"
    )
    output: FileSetting(
        name="Height File",
        description="File to write; its ending decides the format. Empty: a name of its own in the output folder",
    )


class MPS_PG_displace(DisplaceSettings, bpy.types.PropertyGroup):
    """The displacement: its settings, and the heights once they are there."""

    image: PointerProperty(name="Heights", description="Heights on the object's UVs", type=bpy.types.Image)
