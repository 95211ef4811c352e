"""Settings of the photo, its alignment and its lights, and the data stored with an image.

What belongs to a photo goes with it when another one is chosen.
"""

import json
from contextlib import suppress
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, FloatVectorProperty, StringProperty

from mpsnet_core.calibrate.operations import CalibrateLights
from mpsnet_core.capture.operations import Superpose

from ..image_records import from_json, origin, remember, remembered
from .declared import (
    BoolSetting,
    EnumSetting,
    FileSetting,
    FloatSetting,
    InputSetting,
    IntSetting,
    from_option,
    image_pointer,
    object_pointer,
)
from .messages import OWN_SENSE


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
    white: BoolSetting(
        "White Photo",
        "Render a second photo, with the three lights turned white. The estimate uses it, and makes the surface's "
        "colour of it as well",
    )
    animation: BoolSetting(
        "Animation",
        "Take a photo of each frame of the scene, from its first to its last, into a folder. "
        "Lights and camera should move together if they move: those of the first frame count for all",
    )
    output: FileSetting(
        "Photo File", "OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder"
    )


# Settings of the estimate that are of one photo.
OF_ONE_PHOTO = ("white", "white_light", "mask", "mask_file", "background", "distance", "albedo")
# Those that photos of one session, in one folder, share.
OF_ONE_SESSION = ("dark", "flat", "lens", "encoding")
_MASKS_OF_ONE_PHOTO = ("FILE", "BACKGROUND", "PAINTED")
_BELONGINGS = "belongings"


def _photo_chosen(photo: Any, context: Any) -> None:
    """Keep with the photo before what belongs to it, and take what belongs to the one that is chosen now."""
    before, now = photo.settings_of, photo.image
    if now is None or now == before:
        return
    photo.settings_of = now
    owner = photo.id_data.path_resolve(photo.path_from_id().rpartition(".")[0])
    estimate = owner.estimate
    if before is None:  # the first photo: what was entered before is for it
        return
    names = (*OF_ONE_PHOTO, *OF_ONE_SESSION)
    if before.library is None:
        kept = {name: getattr(estimate, name) for name in names if estimate.is_property_set(name)}
        remember(before, _BELONGINGS, json.dumps({**kept, "truth": photo.truth}))
        before.mps.painted_mask = estimate.painted_mask
    stored = remembered(now, _BELONGINGS)
    known = from_json(stored, dict)
    together = stored is None and origin(before).parent == origin(now).parent
    for name in OF_ONE_PHOTO if together else names:
        if name != "mask" or name in known or estimate.mask in _MASKS_OF_ONE_PHOTO:
            estimate.property_unset(name)
        with suppress(TypeError, ValueError):  # a hostile file may hold anything
            if name in known:
                setattr(estimate, name, known[name])
    truth = known.get("truth")
    photo.truth = truth if isinstance(truth, str) else ""
    estimate.painted_mask = now.mps.painted_mask
    if (checked := owner.records.find("check_photo")) >= 0:
        owner.records.remove(checked)
    for record in owner.records:  # what they say is of the photo before
        record.notes = ""


class MPS_PG_photo(PhotoSettings, bpy.types.PropertyGroup):
    """The one photo: how it is rendered, and the image once it is there."""

    image: image_pointer("Photo", "The photo under red, green and blue light", update=_photo_chosen)
    truth: StringProperty(name="True Normals", description="File of the true normals of the photo's view. Empty: none")
    settings_of: image_pointer("Settings Of", "The photo that the white photo, mask and lens in the panel belong to")


class AlignSettings:
    """Where the search for a real photo's camera starts."""

    start: EnumSetting(
        "Start",
        "From where the photo's camera is looked for. Pairs of points go before it",
        items=[
            ("SEARCH", "All Views", "Views all around the mesh are tried; the best one counts"),
            ("VIEWPORT", "Viewport", "The 3D viewport shows the mesh about as the photo does"),
            ("CAMERA", "Camera", "The photo's camera, else the scene's, stands about where the photo was taken"),
        ],
    )


class MPS_PG_align(AlignSettings, bpy.types.PropertyGroup):
    """The alignment: its settings, and the picture that shows how well mesh and photo fit."""

    image: image_pointer("Overlay", "The photo with the outlines of mask and mesh")
    lens_of: object_pointer(
        "Lens Of",
        "Camera whose focal length and shift the photo's camera gets, as of a calibrated lens or a cropped "
        "photo. Where it stands does not count. Empty: Lens (mm), and the photo's middle",
        kind="CAMERA",
    )


class MPS_PG_pair(bpy.types.PropertyGroup):
    """A place in the photo and the same place on the mesh."""

    pixel: FloatVectorProperty(
        name="Pixel", description="Place in the photo in pixels from its top left corner", size=2
    )
    point: FloatVectorProperty(
        name="Point", description="The same place on the mesh, in units of the world", size=3, subtype="XYZ"
    )
    residual: FloatProperty(
        name="Residual",
        description="How far the aligned mesh's point is from the place in the photo, in pixels. -1: not aligned yet",
        default=-1.0,
    )


def _camera_chosen(photo: Any, context: Any) -> None:
    photo.poor, photo.fit, photo.outline_pixels = False, "", -1.0


class MPS_PG_image(bpy.types.PropertyGroup):
    """What belongs to an image that is a photo, normals of one, or a baked texture: ``image.mps``."""

    camera: object_pointer(
        "Taken By",
        "Camera of this scene that took the photo: the one that Align Photo made, or one that you choose",
        kind="CAMERA",
        update=_camera_chosen,
    )
    pairs: CollectionProperty(
        name="Pairs", description="Places in the photo and on the mesh that are the same", type=MPS_PG_pair
    )
    shown: BoolProperty(
        name="Shown", description="Whether the panel shows the picture, not its name alone", default=True
    )
    fit: StringProperty(name="Fit", description="How well the mesh fits the photo, in words. Empty: not aligned")
    outline_pixels: FloatProperty(
        name="Outline",
        description="How far the outlines of mesh and photo are apart, in pixels. -1: not known",
        default=-1.0,
    )
    poor: BoolProperty(name="Poor", description="Whether the mesh fits the photo too poorly to bake with")
    photo: image_pointer("Photo", "The photo that these normals were estimated from")
    painted_mask: image_pointer("Painted Mask", "The mask that was painted for this photo, while another is chosen")
    coverage: image_pointer("Coverage", "Which of this texture's texels some view saw")


class CalibrateSettings:
    """From what the lights are found; photos of balls, for their positions and the mixing of their colours, too."""

    source: EnumSetting(
        "From",
        "What shows where the lights are",
        items=[
            ("PHOTO", "Photo", "The photo itself, by its shading and outline: 3° to 10° off on average"),
            ("MESH", "Mesh", "The photo and the target's mesh, once the photo is aligned with it: within about 1.5°"),
            ("BALL", "Ball", "Photo of a mirror ball under all three lights: within about 0.5°"),
            ("LAMPS", "3 Photos", "Three photos of a mirror ball, each of them under one light alone"),
        ],
        default="BALL",
        translation_context=OWN_SENSE,
    )
    ball: InputSetting(
        "Mirror Ball",
        "Photo of a mirror ball where the object stands, under the red, green and blue light at once. "
        "From three photos: under the first light alone",
        translation_context=OWN_SENSE,
    )
    second_ball: InputSetting(
        "Second Place",
        "Photo of the same ball at another place. With two places the lights' positions are found, "
        "not only their directions. Needs the lens",
    )
    second_light: InputSetting("Second Light", "Photo of the same ball in the same place, under the second light alone")
    third_light: InputSetting("Third Light", "Photo of the same ball in the same place, under the third light alone")
    ball_radius: from_option(CalibrateLights, "radius", name="Ball Radius", default=1.0, low=1e-6)
    grey: InputSetting("Grey Ball", "Photo of a matt grey ball under the red, green and blue light at once")
    lens: from_option(CalibrateLights, "focal", name="Lens (mm)", unset="the camera is assumed to be far away")
    circle_x: FloatSetting(
        "Ball X (px)", "Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below"
    )
    circle_y: FloatSetting("Y (px)", "Middle of the ball, in pixels from the photo's top edge")
    circle_radius: FloatSetting(
        "Radius (px)", "Radius of the ball's outline in pixels. 0: the ball is looked for", min=0.0
    )
    second_x: FloatSetting(
        "Second X (px)", "Middle of the ball at its second place, in pixels from the photo's left edge"
    )
    second_y: FloatSetting("Y (px)", "Middle of the ball at its second place, in pixels from the photo's top edge")
    second_radius: FloatSetting(
        "Radius (px)",
        "Radius of the ball's outline at its second place, in pixels. Needed where the first one is given",
        min=0.0,
    )
    encoding: from_option(CalibrateLights, "encoding")
    output: FileSetting("Rig File", "Rig file to write (.json). Empty: a name of its own in the output folder")


class MPS_PG_calibrate(CalibrateSettings, bpy.types.PropertyGroup):
    """Calibration: its photos, and what was found."""

    image: image_pointer("Found", "What was found, drawn over the photo")
    summary: StringProperty(name="Found", description="Table of what was found: lines of cells with | between them")


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
        "Third Light",
        "Photo of the same pose under the third white light alone, from the third side: the blue channel",
    )
    encoding: from_option(Superpose, "encoding")
    output: FileSetting("File", "OpenEXR file to write. Empty: a name of its own in the output folder")


class MPS_PG_superpose(SuperposeSettings, bpy.types.PropertyGroup):
    """Three photos under one white light each."""
