"""The bake's settings."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from .declared import FILE_FORMATS, GIVEN, PATH


class BakeSettings:
    """The texture and how it is baked."""

    uv_map: StringProperty(
        name="UV Map",
        description="UV map of the target to bake onto. Empty: the one that is active for rendering",
        options=GIVEN,
    )
    size: IntProperty(
        name="Size",
        description="Width and height of the texture in pixels",
        default=2048,
        min=16,
        max=16384,
        options=GIVEN,
    )
    space: EnumProperty(
        name="Space",
        description="What the texture's normals are relative to",
        items=[
            ("TANGENT", "Tangent", "To the surface: the object may move, bend and be reused. The usual choice"),
            ("OBJECT", "Object", "To the object: for objects that do not bend"),
        ],
        default="TANGENT",
        options=GIVEN,
    )
    convention: EnumProperty(
        name="Convention",
        description="Which way the texture's green channel points",
        items=[
            ("OPENGL", "OpenGL", "Green is up: Blender, glTF, Unity"),
            ("DIRECTX", "DirectX", "Green is down: Unreal Engine. In Blender the material turns it round"),
        ],
        default="OPENGL",
        options=GIVEN,
    )
    animated: BoolProperty(
        name="Follow the Animation",
        description="For a sequence of normals: take the target and the camera anew in each frame of the timeline, "
        "whose number is that of the normals. Off: as they stand now",
        default=False,
        options=GIVEN,
    )
    all_rigs: BoolProperty(
        name="All Rigs",
        description="Bake the normals of all rigs of this scene together, each as its own camera saw them. "
        "Off: those of the chosen rig alone",
        default=False,
        options=GIVEN,
    )
    margin: IntProperty(
        name="Margin",
        description="Pixels by which the texture is continued beyond the borders of the UV islands",
        default=16,
        min=0,
        max=1024,
        options=GIVEN,
    )
    file_format: EnumProperty(
        name="Format", description="File format of the texture", items=FILE_FORMATS, default="PNG", options=GIVEN
    )
    output: StringProperty(
        name="Texture File",
        description="File to write; its ending decides the format. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class MPS_PG_bake(BakeSettings, bpy.types.PropertyGroup):
    """The bake: its settings and target, and the texture once it is there."""

    target: PointerProperty(
        name="Target",
        description="Mesh object that gets the texture. Empty: the active object",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "MESH",
    )
    image: PointerProperty(name="Texture", description="The baked normal texture", type=bpy.types.Image)
