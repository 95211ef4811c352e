"""Settings of the estimate, and of flat materials, which estimate normals, too."""

import bpy
from bpy.props import IntProperty, StringProperty

from mpsnet_core.defaults import BY_PHOTO
from mpsnet_core.estimate.operations import Estimate
from mpsnet_core.estimate.registry import OLD_NAMES, known_models
from mpsnet_core.relief.operations import MakeMaterial

from .declared import (
    BoolSetting,
    EnumSetting,
    FloatSetting,
    InputSetting,
    IntSetting,
    format_setting,
    from_option,
    identifier,
    image_pointer,
    object_pointer,
)

MODELS = {identifier(entry.name): entry for entry in known_models()}
MODEL_ITEMS = [(name, entry.label, entry.title, entry.number) for name, entry in MODELS.items()]
_AUTO = (
    identifier(BY_PHOTO),
    "Automatic",
    "Equation 2 where the photo shows a matt material, the default network where it shows a glossy one",
    10,
)
# What presets and scripts of earlier versions set. The menus do not list it, and the setting then has its new name.
MODEL_ITEMS += [
    (identifier(old), *MODEL_ITEMS[[*MODELS].index(identifier(name))][1:]) for old, name in OLD_NAMES.items()
]


class EstimateSettings:
    """How the photo is read, and which model estimates the normals."""

    mask: EnumSetting(
        "Mask",
        "Which pixels of the photo are the object",
        items=[
            (
                "AUTO",
                "Alpha or Find",
                "The photo's alpha if it has one, as rendered photos do; else the object if it stands out clearly; "
                "else the whole photo",
            ),
            (
                "FIND",
                "Find Object",
                "What stands out from a dark or plain background, which takes up most of the photo's border",
            ),
            ("BACKGROUND", "Background Photo", "Where the photo differs from one of the scene without the object"),
            ("ALPHA", "Alpha", "Where the photo is opaque"),
            ("FILE", "File", "Where a mask picture is white"),
            ("THRESHOLD", "Threshold", "Where the photo is brighter than a threshold"),
            ("NONE", "None", "The whole photo: a wall or cloth that fills it"),
            ("PAINTED", "Painted", "What is bright in the picture that Paint Mask opens, as it is painted now"),
        ],
    )
    mask_file: InputSetting("Mask File", "Picture that is white where the object is and black elsewhere")
    background: InputSetting("Background", "Photo of the scene without the object, under the same lights")
    threshold: FloatSetting(
        "Threshold",
        "Pixels brighter than this fraction of the photo's brightest are the object",
        default=0.05,
        within=(0.0, 0.99),
    )
    encoding: from_option(Estimate, "encoding")
    dark: from_option(Estimate, "dark", name="Dark Frame")
    flat: from_option(Estimate, "flat", name="Flat Field")
    white: from_option(Estimate, "white", name="White Photo")
    white_light: from_option(Estimate, "white_light", name="White Light", unset="the rig's three lights")
    rig_file: InputSetting(
        "Rig File",
        "Measured rig (.json or .lp) of photos that you open. A photo that was rendered in this scene is "
        "estimated with the rig that it was rendered with. Empty: the rig beside the photo when it was opened, else "
        "the rig in this scene, else the lights are found in the photo",
    )
    lens: from_option(
        Estimate, "focal", name="Lens (mm)", unset="the camera that the photo was rendered with, else the rig's"
    )
    distance: from_option(Estimate, "distance", unset="as far as the rig's target, or by the surface")
    model: from_option(Estimate, "model", items=[*MODEL_ITEMS, ("FILE", "File", "A network in an .onnx file", 9)])
    average_passes: BoolSetting(
        "Average Passes",
        "Average the default network's answers on the scene turned and mirrored, and estimate surfaces of "
        "many colours twice: better, at half to a sixth of its speed. For stills; frames of a sequence or video get "
        "one pass",
        default=True,
    )
    model_file: InputSetting("Model File", "Network in an .onnx file")
    confidence: from_option(Estimate, "confidence", name="Confidence Map", switch=True)
    albedo: from_option(Estimate, "albedo", switch=True)
    smooth: from_option(Estimate, "smooth", name="Smooth Frames")
    file_format: format_setting("File format of the normal map")
    output: from_option(Estimate, "output", name="Normal Map File", unset="a name of its own in the output folder")


class MPS_PG_estimate(EstimateSettings, bpy.types.PropertyGroup):
    """The estimate: its settings, and the normal map once it is there."""

    kept_rig: StringProperty(options={"HIDDEN"})  # JSON, see photo/find_lights.py
    first_frame: IntProperty(description="Number of the first frame of normals, where they are a sequence")
    last_frame: IntProperty(description="Number of the last frame of normals, where they are a sequence")
    mask_image: image_pointer("Mask", "The mask, drawn over the photo")
    surface: object_pointer(
        "Surface",
        "Mesh that gives each pixel's distance to near lights (area and point lights). "
        "Empty: all is assumed to be as far as the rig's target",
        kind="MESH",
    )
    mesh: object_pointer("Mesh", "Mesh that was made of the normals and their heights")
    error_image: image_pointer("Errors", "The angles between the normals and the true ones")
    painted_mask: image_pointer(
        "Painted Mask", "The photo, bright where it is the object and dark elsewhere, to be painted on"
    )
    albedo_image: image_pointer("Albedo", "The surface's colour")
    image: image_pointer("Normals", "Normal map in camera space")


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
