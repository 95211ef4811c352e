"""The estimate's settings."""

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.estimate.registry import DEFAULT_MODEL, registered_models

from .declared import ENCODINGS, FILE_FORMATS, GIVEN, PATH


def _identifier(model: str) -> str:
    """A model's name as Blender writes enums: upper case, words joined by underscores."""
    return model.upper().replace("-", "_")


MODELS = {_identifier(entry.name): entry for entry in registered_models()}


class EstimateSettings:
    """How the photo is read and which model turns it into normals."""

    mask: EnumProperty(
        name="Mask",
        description="Which pixels of the photo are the object",
        items=[
            (
                "AUTO",
                "Alpha or Find",
                "The photo's alpha if it has one, as rendered photos do; else the object is found as by Find Object",
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
        ],
        default="AUTO",
        options=GIVEN,
    )
    mask_file: StringProperty(
        name="Mask File",
        description="Picture that is white where the object is and black elsewhere",
        subtype="FILE_PATH",
        options=PATH,
    )
    background: StringProperty(
        name="Background",
        description="Photo of the scene without the object, under the same lights",
        subtype="FILE_PATH",
        options=PATH,
    )
    threshold: FloatProperty(
        name="Threshold",
        description="Pixels brighter than this fraction of the photo's brightest are the object",
        default=0.05,
        min=0.0,
        max=0.99,
        options=GIVEN,
    )
    encoding: EnumProperty(
        name="Encoding",
        description="How the photo's values stand for light",
        items=ENCODINGS,
        default="AUTO",
        options=GIVEN,
    )
    dark: StringProperty(
        name="Dark Frame",
        description="Photo with the three lights off, taken off the photo. A folder or pattern of several is averaged",
        subtype="FILE_PATH",
        options=PATH,
    )
    flat: StringProperty(
        name="Flat Field",
        description="Photo of an even white card in the object's place, which evens out lens and lights. "
        "A folder or pattern of several is averaged. Not together with near lights",
        subtype="FILE_PATH",
        options=PATH,
    )
    white: StringProperty(
        name="White Photo",
        description="Second photo of the same pose, under white light: the three lights turned white. It tells the "
        "colour of the surface. A folder or pattern of one photo for each light is added up. For one still photo only",
        subtype="FILE_PATH",
        options=PATH,
    )
    rig_file: StringProperty(
        name="Rig File",
        description="Measured rig (.json or .lp) of photos that you open. A photo that was rendered in this scene is "
        "estimated with the rig that it was rendered with. Empty: the rig beside the photo when it was opened, else "
        "the rig in this scene",
        subtype="FILE_PATH",
        options=PATH,
    )
    lens: FloatProperty(
        name="Lens (mm)",
        description="Focal length of the real camera in millimetres on a sensor 36 mm wide. "
        "0: the camera that the photo was rendered with, else the rig's",
        default=0.0,
        min=0.0,
        max=10000.0,
        options=GIVEN,
    )
    distance: FloatProperty(
        name="Distance",
        description="How far the object is from the camera, in the unit of a rig file with near lights. "
        "0: as far as the rig's target, or as the surface tells",
        default=0.0,
        min=0.0,
        max=1e6,
        options=GIVEN,
    )
    model: EnumProperty(
        name="Model",
        description="What turns the photo into normals",
        items=[
            *((identifier, entry.label, entry.title) for identifier, entry in MODELS.items()),
            ("FILE", "File", "A network in an .onnx file"),
        ],
        default=_identifier(DEFAULT_MODEL),
        options=GIVEN,
    )
    average_passes: BoolProperty(
        name="Average Passes",
        description="Average the default network's answers on the scene turned and mirrored: better, at a third of its "
        "speed. For stills; frames of a sequence or video get one pass",
        default=True,
        options=GIVEN,
    )
    model_file: StringProperty(
        name="Model File", description="Network in an .onnx file", subtype="FILE_PATH", options=PATH
    )
    confidence: BoolProperty(
        name="Confidence Map",
        description="Also write how far each normal can be trusted, beside the normal map",
        default=False,
        options=GIVEN,
    )
    albedo: BoolProperty(
        name="Albedo",
        description="Also write the surface's colour without light and shadow on it, beside the normal map. It is made "
        "from the white photo of Photo > Real Photo",
        default=False,
        options=GIVEN,
    )
    smooth: IntProperty(
        name="Smooth Frames",
        description="Frames of a sequence or video before and behind, with which each is averaged where they show "
        "the same",
        default=0,
        min=0,
        max=12,
        options=GIVEN,
    )
    file_format: EnumProperty(
        name="Format", description="File format of the normal map", items=FILE_FORMATS, default="PNG", options=GIVEN
    )
    output: StringProperty(
        name="Normal Map File",
        description="File to write; its ending decides the format. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class MPS_PG_estimate(EstimateSettings, bpy.types.PropertyGroup):
    """The estimate: its settings, and the normal map once it is there."""

    first_frame: IntProperty(description="Number of the first frame of normals, where they are a sequence")
    last_frame: IntProperty(description="Number of the last frame of normals, where they are a sequence")
    mask_image: PointerProperty(name="Mask", description="The mask, drawn over the photo", type=bpy.types.Image)
    surface: PointerProperty(
        name="Surface",
        description="Mesh that tells how far each pixel is from near lights (area and point lights). "
        "Empty: all is taken as far as the rig's target",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "MESH",
    )
    mesh: PointerProperty(
        name="Mesh", description="Mesh that was made of the normals and their heights", type=bpy.types.Object
    )
    albedo_image: PointerProperty(name="Albedo", description="The surface's colour", type=bpy.types.Image)
    image: PointerProperty(name="Normals", description="Normal map in camera space", type=bpy.types.Image)
