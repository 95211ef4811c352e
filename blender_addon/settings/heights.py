"""Settings of the heights, a mesh and images from the photo's normals, and of the displacement."""

import bpy

from mpsnet_core.relief.operations import Integrate

from .declared import BoolSetting, EnumSetting, FileSetting, IntSetting, format_setting, from_option, image_pointer
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


class DisplaceSettings:
    """The heights of the baked texture, and how they displace the object."""

    method: EnumSetting(
        "Displace By",
        "What moves the surface",
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
    )
    automatic: BoolSetting(
        "Automatic",
        "Choose Subdivisions and Broadest by the mesh's faces and the texture's pixels: the relief gets the faces that "
        "it needs, and shapes broader than the mesh's own faces stay with the mesh. A script that gives one of them "
        "decides both",
        default=True,
    )
    levels: IntSetting(
        "Subdivisions",
        "How often the mesh is subdivided first: each makes four times as many faces, which take more of "
        "the relief's shape. But a low poly's facets show more in its shadows, as Cycles softens those of large faces. "
        "0: its own vertices move, and the normal map shows the rest",
        within=(0, 8),
    )
    subdivision: EnumSetting(
        "Subdivide",
        "How the mesh is subdivided",
        items=[
            (
                "CATMULL_CLARK",
                "Catmull-Clark",
                "The mesh becomes round, edges with a crease apart: for one that is made for it",
            ),
            ("SIMPLE", "Simple", "The mesh keeps its shape, its smooth shading and its sharp edges"),
        ],
        default="SIMPLE",
    )
    # The core's default keeps all, for any normals. The errors of estimated ones are largest in broad shapes, which a
    # low-poly mesh of a few thousand faces has already.
    scale: from_option(Integrate, "scale", name="Broadest", default=0.01)
    keep_normals: BoolSetting(
        "Keep the Normals",
        "Shade the displaced surface by the baked normals, subdivided as a texture in object space: the "
        "relief shows once, with what is finer than the mesh. Off, for objects that bend: by the displaced surface "
        "alone",
        default=True,
    )
    file_format: format_setting(
        "File format of the heights. OpenEXR holds them in world units, the others from black to white", default="EXR"
    )
    output: FileSetting(
        "Height File", "File to write; its ending decides the format. Empty: a name of its own in the output folder"
    )


class MPS_PG_displace(DisplaceSettings, bpy.types.PropertyGroup):
    """The displacement: its settings, and the heights once they are there."""

    image: image_pointer("Heights", "Heights on the object's UVs")
