"""The bake's settings."""

from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.bake.presets import PRESETS
from mpsnet_core.defaults import MARGIN, TEXTURE_SIZE

from .declared import FILE_FORMATS, GIVEN, PATH

CONVENTIONS = (
    ("OPENGL", "OpenGL", "Green is up: Blender, glTF, Unity, Godot"),
    ("DIRECTX", "DirectX", "Green is down: Unreal Engine. In Blender the material turns it round"),
)
_FORMAT_OF = {".png": "PNG", ".tif": "TIFF", ".exr": "EXR"}
# What each format can hold.
_BITS = {"PNG": {"AUTO", "8", "16"}, "TIFF": {"AUTO", "8", "16", "32"}, "EXR": {"AUTO", "16", "32"}}


def _take_preset(settings: Any, context: Any) -> None:
    # An operator has its preset from the scene's settings, which may have been changed since it was chosen.
    if settings.preset == "CUSTOM" or not isinstance(settings, bpy.types.PropertyGroup):
        return
    preset = PRESETS[settings.preset.lower()]
    settings.space, settings.convention = "TANGENT", preset.convention.upper()
    settings.file_format, settings.bits = _FORMAT_OF[preset.suffix], str(preset.bits)


def _take_format(settings: Any, context: Any) -> None:
    if isinstance(settings, bpy.types.PropertyGroup) and settings.bits not in _BITS[settings.file_format]:
        settings.bits = "AUTO"


def _take_detail(settings: Any, context: Any) -> None:
    if settings.onto and isinstance(settings, bpy.types.PropertyGroup):
        settings.level = True


class BakeSettings:
    """The texture and how it is baked. What sets others stands before them: those that are given as well win."""

    preset: EnumProperty(
        name="Preset",
        description="Convention, depth, format and automatic name as a program wants them; each may be changed",
        items=[
            ("CUSTOM", "Custom", "As set below; what another preset has set stays until it is changed"),
            *(
                (name.upper(), preset.label, f"{preset.stem('NAME')}{preset.suffix}, {preset.bits} bits a channel")
                for name, preset in PRESETS.items()
            ),
        ],
        default="CUSTOM",
        update=_take_preset,
        options=GIVEN,
    )
    onto: BoolProperty(
        name="On Top",
        description="Add the detail to the normal maps that the objects wear, which stay as they are beneath",
        default=False,
        update=_take_detail,
        options=GIVEN,
    )
    uv_map: StringProperty(
        name="UV Map",
        description="UV map of the target to bake onto. Empty: the one that is active for rendering",
        options=GIVEN,
    )
    objects: EnumProperty(
        name="Objects",
        description="Which objects are baked onto, in one go: they hide one another from the cameras",
        items=[
            ("ACTIVE", "Target", "The target alone"),
            ("SELECTED", "Selected", "All selected mesh objects"),
        ],
        default="ACTIVE",
        options=GIVEN,
    )
    split: EnumProperty(
        name="Textures",
        description="What has a texture of its own",
        items=[
            ("ONE", "One for All", "All that is baked shares one texture; the UVs of several objects must not overlap"),
            ("MATERIAL", "By Material", "One for each material; its name goes into the file's name"),
            ("OBJECT", "By Object", "One for each object; its name goes into the file's name"),
        ],
        default="ONE",
        options=GIVEN,
    )
    tiles: BoolProperty(
        name="UDIM Tiles",
        description="A texture for each unit square that the UVs lie in, numbered 1001, 1002 and so on. Size is that "
        "of each",
        default=False,
        options=GIVEN,
    )
    size: IntProperty(
        name="Size",
        description="Width and height of the texture in pixels",
        default=TEXTURE_SIZE,
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
        items=CONVENTIONS,
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
    samples: EnumProperty(
        name="Samples",
        description="Points of the surface that each pixel is the mean of: more take longer and lessen jagged edges",
        items=[
            ("1", "1", "One in the pixel's middle"),
            ("2", "2 x 2", "Four a pixel: about four times as long"),
            ("4", "4 x 4", "Sixteen a pixel: about sixteen times as long"),
        ],
        default="1",
        options=GIVEN,
    )
    padding: EnumProperty(
        name="Padding",
        description="What lies beyond the borders of the UV islands, where a texture that is made smaller reaches",
        items=[
            ("NEAREST", "Nearest", "The islands are continued by the margin"),
            ("PUSH_PULL", "Push-Pull", "The whole texture is filled, smoothly"),
            ("NONE", "None", "Nothing: flat normals"),
        ],
        default="NEAREST",
        options=GIVEN,
    )
    margin: IntProperty(
        name="Margin",
        description="Pixels by which the texture is continued beyond the borders of the UV islands",
        default=MARGIN,
        min=0,
        max=1024,
        options=GIVEN,
    )
    file_format: EnumProperty(
        name="Format",
        description="File format of the texture; one that cannot hold the chosen depth takes its own",
        items=FILE_FORMATS,
        default="PNG",
        update=_take_format,
        options=GIVEN,
    )
    bits: EnumProperty(
        name="Depth",
        description="Bits a channel of the texture",
        items=[
            ("AUTO", "Automatic", "16 bits, in OpenEXR 32"),
            ("8", "8 Bits", "PNG and TIFF"),
            ("16", "16 Bits", "All formats"),
            ("32", "32 Bits", "TIFF and OpenEXR"),
        ],
        default="AUTO",
        options=GIVEN,
    )
    output: StringProperty(
        name="Texture File",
        description="File to write; its ending decides the format. A folder: a name of its own in it. "
        "Empty: in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )
    level: BoolProperty(
        name="Detail Only",
        description="Take large shapes from the object and only detail from the photo, whatever else the estimate says",
        default=False,
        options=GIVEN,
    )
    level_scale: FloatProperty(
        name="Cut-Off",
        description="What is smaller than this fraction of the object's size is detail, and taken from the photo",
        default=0.03,
        min=0.01,
        max=0.5,
        precision=3,
        options=GIVEN,
    )
    strength: FloatProperty(
        name="Strength",
        description="Fraction of the photo's relief that is added to the object's own surface: 1 as it is, 0 none",
        default=1.0,
        min=0.0,
        max=2.0,
        options=GIVEN,
    )
    onto_file: StringProperty(
        name="Present Map",
        description="File of the normal map to go on top of; <OBJECT>, <MATERIAL> and <UDIM> in its name stand for "
        "what each texture is of. Empty: those in the materials",
        subtype="FILE_PATH",
        options=PATH,
    )
    onto_convention: EnumProperty(
        name="Its Convention",
        description="Which way the green channel of that file points",
        items=CONVENTIONS,
        default="OPENGL",
        options=GIVEN,
    )
    onto_shown: EnumProperty(
        name="In the Photo",
        description="Whether the photo shows the present map's relief as well, which is then not added again",
        items=[
            ("AUTO", "Find Out", "Compare the photo's normals with the map"),
            ("YES", "Yes", "The map was made of the same object"),
            ("NO", "No", "The map was sculpted or painted"),
        ],
        default="AUTO",
        options=GIVEN,
    )


class MPS_PG_bake(BakeSettings, bpy.types.PropertyGroup):
    """The bake: its settings and target, and the texture once it is there."""

    target: PointerProperty(
        name="Target",
        description="Mesh object that gets the texture. Empty: the active object. Photos that are rendered leave the "
        "target out where the detailed object is in its place",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "MESH",
    )
    image: PointerProperty(name="Texture", description="The baked normal texture", type=bpy.types.Image)
