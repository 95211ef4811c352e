"""Settings of the calibration of real lights."""

import bpy
from bpy.props import StringProperty

from mpsnet_core.calibrate.operations import CalibrateLights

from .declared import EnumSetting, FileSetting, FloatSetting, InputSetting, from_option, image_pointer
from .messages import OWN_SENSE


class CalibrateSettings:
    """From what the lights are found; photos of balls, for their positions and the mixing of their colours, too."""

    source: EnumSetting(
        "From",
        "What shows where the lights are",
        items=[
            ("PHOTO", "Photo", "The photo itself, by its shading and outline: within about 10°"),
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
