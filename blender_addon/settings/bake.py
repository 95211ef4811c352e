"""Settings of the bake, of one view and of many, and the state that relighting restores when it ends."""

from typing import Any

import bpy
from bpy.props import CollectionProperty, StringProperty

from mpsnet_core.bake.operations import Bake, BakeViews
from mpsnet_core.bake.presets import PRESETS
from mpsnet_core.defaults import LEVEL_SCALE, MARGIN, MAX_LEVEL_SCALE, MAX_TEXTURE_SIZE, MIN_LEVEL_SCALE, TEXTURE_SIZE

from ..outputs import FORMAT_OF
from .declared import (
    BoolSetting,
    EnumSetting,
    FloatSetting,
    IntSetting,
    StringSetting,
    format_setting,
    from_option,
    image_pointer,
    items_of,
    object_pointer,
)
from .messages import OWN_SENSE
from .rig import MPS_PG_light

# The bit depths of each format.
_BITS = {"PNG": {"AUTO", "8", "16"}, "TIFF": {"AUTO", "8", "16", "32"}, "EXR": {"AUTO", "16", "32"}}


def _take_preset(settings: Any, context: Any) -> None:
    # Not for operators: they take the preset from the scene, whose settings may have changed since it was chosen.
    if settings.preset == "CUSTOM" or not isinstance(settings, bpy.types.PropertyGroup):
        return
    preset = PRESETS[settings.preset.lower()]
    settings.space, settings.convention = "TANGENT", preset.convention.upper()
    settings.file_format, settings.bits = FORMAT_OF[preset.suffix], str(preset.bits)


def _take_format(settings: Any, context: Any) -> None:
    if isinstance(settings, bpy.types.PropertyGroup) and settings.bits not in _BITS[settings.file_format]:
        settings.bits = "AUTO"


def _take_detail(settings: Any, context: Any) -> None:
    if settings.onto and isinstance(settings, bpy.types.PropertyGroup):
        settings.level = True


def detail_only(*, default: bool) -> Any:
    return BoolSetting(
        "Detail Only",
        "Take large shapes from the object alone and only detail from the photos: seams between views vanish. For an "
        "object whose large shapes are more exact than the estimates",
        default=default,
    )


def cut_off() -> Any:
    return FloatSetting(
        "Cut-Off",
        "What is smaller than about twice this fraction of the object's size is detail, and taken from the photos",
        default=LEVEL_SCALE,
        precision=3,
        within=(MIN_LEVEL_SCALE, MAX_LEVEL_SCALE),
    )


class BakeSettings:
    """The texture and how it is baked. Settings that set others come before them, so explicit values win."""

    preset: from_option(
        Bake,
        "preset",
        items=[
            ("CUSTOM", "Custom", "As set below; what another preset has set stays until it is changed"),
            *items_of(Bake, "preset", {name: preset.label for name, preset in PRESETS.items()}),
        ],
        update=_take_preset,
    )
    onto: BoolSetting(
        "On Top",
        "Add the detail to the normal maps that the objects use, which stay as they are beneath",
        update=_take_detail,
    )
    uv_map: StringSetting("UV Map", "UV map of the target to bake onto. Empty: the one that is active for rendering")
    objects: EnumSetting(
        "Objects",
        "Which objects are baked onto, in one go: they hide one another from the cameras",
        items=[("ACTIVE", "Target", "The target alone"), ("SELECTED", "Selected", "All selected mesh objects")],
    )
    split: EnumSetting(
        "Textures",
        "What has a texture of its own",
        items=[
            ("ONE", "One for All", "All that is baked shares one texture; the UVs of several objects must not overlap"),
            ("MATERIAL", "By Material", "One for each material; its name goes into the file's name"),
            ("OBJECT", "By Object", "One for each object; its name goes into the file's name"),
        ],
    )
    tiles: BoolSetting(
        "UDIM Tiles",
        "A texture for each unit square that the UVs lie in, numbered 1001, 1002 and so on. Size is that of each",
    )
    size: IntSetting(
        "Size", "Width and height of the texture in pixels", default=TEXTURE_SIZE, within=(1, MAX_TEXTURE_SIZE)
    )
    space: from_option(Bake, "space", translation_context=OWN_SENSE)
    convention: from_option(Bake, "convention")
    animated: BoolSetting(
        "Follow the Animation",
        "For a sequence of normals: take the target and the camera anew in each frame of the timeline, "
        "whose number is that of the normals. Off: as they stand now",
    )
    all_rigs: BoolSetting(
        "All Rigs",
        "Bake the normals of all rigs of this scene together, each as its own camera saw them. "
        "Off: those of the chosen rig alone",
    )
    samples: from_option(Bake, "samples", labels={2: "2 x 2", 4: "4 x 4"})
    padding: from_option(Bake, "padding")
    # The core's default is None, because it applies to one padding only.
    margin: from_option(Bake, "margin", default=MARGIN)
    file_format: format_setting(
        "File format of the texture; one that cannot hold the chosen depth takes its own", update=_take_format
    )
    bits: from_option(
        Bake,
        "bits",
        name="Depth",
        items=[
            ("AUTO", "Automatic", "16 bits, 32 in OpenEXR"),
            *items_of(Bake, "bits", {8: "8 Bits", 16: "16 Bits", 32: "32 Bits"}),
        ],
    )
    output: from_option(Bake, "output", name="Texture File", unset="in the output folder")
    level: detail_only(default=False)
    agreed: BoolSetting(
        "Blend With the Mesh",
        "Take large shapes partly from the object, as far as it and the estimate agree within the error that the "
        "estimate expects of itself. Off: all as estimated",
        default=True,
    )
    level_scale: cut_off()
    strength: from_option(Bake, "strength")
    fill: from_option(Bake, "fill", name="Fill Unseen")
    onto_file: from_option(Bake, "onto", name="Present Map", unset="those in the materials")
    onto_convention: from_option(Bake, "onto_convention", name="Its Convention")
    onto_shown: from_option(Bake, "onto_shown", name="In the Photo", labels={"auto": "Find Out"})
    assign: BoolSetting(
        "Assign to Materials",
        "Show the texture in the objects' materials. Off: write the files and change no object, material "
        "or image, so that linked and overridden assets get textures too",
        default=True,
    )
    mark_asset: EnumSetting(
        "Mark as Asset",
        "What Blender's Asset Browser shows of the result",
        items=[
            ("NONE", "Nothing", "Mark nothing; what is marked already stays so"),
            ("MATERIAL", "Material", "The materials that use the texture"),
            ("OBJECT", "Object", "The objects that use the texture"),
        ],
    )


class MPS_PG_overlay(bpy.types.PropertyGroup):
    """A copy of an object that shows its coverage; a pointer, so that it survives renaming."""

    object: object_pointer("Overlay", "Copy that shows the coverage")


class MPS_PG_bake(BakeSettings, bpy.types.PropertyGroup):
    """The bake: its settings and target, and the texture once it is there."""

    target: object_pointer(
        "Target",
        "Mesh object that gets the texture. Empty: the active object. Photos that are rendered leave the "
        "target out where the detailed object is in its place",
        kind="MESH",
    )
    baked: object_pointer("Baked", "Mesh object that the texture was baked onto, where it is a single one")
    image: image_pointer("Texture", "The baked normal texture")
    overlays: CollectionProperty(
        name="Overlays", description="The copies that show the coverage, while it is shown", type=MPS_PG_overlay
    )
    shading: StringProperty(
        name="Shading", description="Viewport that shows the coverage, and how it was shaded before, as JSON"
    )


class ViewsSettings:
    """Photos from all around with their cameras, and how they are baked into one texture."""

    cameras: from_option(BakeViews, "cameras", unset="this scene's cameras, each with its photo as background image")
    photos: from_option(BakeViews, "photos", unset="")
    white: from_option(BakeViews, "white", name="White Photos", unset="no albedo is baked")
    axes: EnumSetting(
        "Mesh Import",
        "How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet",
        items=[
            ("Y_UP", "Y Up", "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do by default"),
            ("AS_IS", "As It Is", "With forward Y and up Z, as Blender's importer of PLY does"),
        ],
    )
    lights_in: from_option(
        BakeViews, "lights_in", name="Lights", labels={"camera": "Go With the Camera", "world": "Stand Still"}
    )
    level: detail_only(default=True)
    level_scale: cut_off()
    keep: from_option(BakeViews, "keep", name="Keep Normals")
    write_report: from_option(BakeViews, "report", switch=True, default=True, translation_context=OWN_SENSE)


class MPS_PG_views(ViewsSettings, bpy.types.PropertyGroup):
    """Many views: their settings, and the report of the last bake."""

    report_file: StringProperty()


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    neutral: BoolSetting(
        "Neutral Material",
        "From the next Relight on, show objects in grey whose albedo was not baked, so that colours do not hide their "
        "relief. Their own materials stay as they are",
        default=True,
    )
    overlays: CollectionProperty(
        name="Overlays", description="The copies in neutral materials, while they are shown", type=MPS_PG_overlay
    )
    pivot: object_pointer("Pivot", "Empty that the lamp swings around")
    lamp: object_pointer("Lamp", "The lamp, while it is there")
    hidden: CollectionProperty(name="Hidden", description="The rigs' lights that it hid", type=MPS_PG_light)
    view_layer: StringProperty(name="View Layer", description="Where it hid them")
    shading: StringProperty(name="Shading", description="How the viewport was shaded before, as JSON")
