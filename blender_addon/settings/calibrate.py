"""Settings of the calibration of real lights."""

import bpy
from bpy.props import PointerProperty, StringProperty

from mpsnet_core.calibrate.operations import CalibrateLights

from .declared import OWN_SENSE, FileSetting, FloatSetting, from_option


class CalibrateSettings:
    """Photos of balls to calibrate the positions of real lights and the mixing of their colours."""

    ball: FileSetting(
        name="Mirror Ball",
        description="Photo of a mirror ball where the object stands, under the red, green and blue light at once",
        translation_context=OWN_SENSE,
    )
    second_ball: FileSetting(
        name="Second Place",
        description="Photo of the same ball at another place. With two places the lights' positions are found, "
        "not only their directions. Needs the lens",
    )
    ball_radius: from_option(CalibrateLights, "radius", name="Ball Radius", default=1.0, low=1e-6)
    grey: FileSetting(
        name="Grey Ball", description="Photo of a matt grey ball under the red, green and blue light at once"
    )
    lens: from_option(CalibrateLights, "focal", name="Lens (mm)", unset="the camera is assumed to be far away")
    circle_x: FloatSetting(
        name="Ball X (px)",
        description="Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below",
        default=0.0,
    )
    circle_y: FloatSetting(
        name="Y (px)", description="Middle of the ball, in pixels from the photo's top edge", default=0.0
    )
    circle_radius: FloatSetting(
        name="Radius (px)",
        description="Radius of the ball's outline in pixels. 0: the ball is looked for",
        default=0.0,
        min=0.0,
    )
    second_x: FloatSetting(
        name="Second X (px)",
        description="Middle of the ball at its second place, in pixels from the photo's left edge",
        default=0.0,
    )
    second_y: FloatSetting(
        name="Y (px)",
        description="Middle of the ball at its second place, in pixels from the photo's top edge",
        default=0.0,
    )
    second_radius: FloatSetting(
        name="Radius (px)",
        description="Radius of the ball's outline at its second place, in pixels. Needed where the first one is given",
        default=0.0,
        min=0.0,
    )
    encoding: from_option(CalibrateLights, "encoding")
    output: FileSetting(
        name="Rig File", description="Rig file to write (.json). Empty: a name of its own in the output folder"
    )


class MPS_PG_calibrate(CalibrateSettings, bpy.types.PropertyGroup):
    """Calibration: its photos, and what was found."""

    image: PointerProperty(name="Found", description="What was found, drawn over the photo", type=bpy.types.Image)
    summary: StringProperty(name="Found", description="Table of what was found: lines of cells with | between them")
