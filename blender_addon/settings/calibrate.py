"""Settings of the calibration of real lights."""

import bpy
from bpy.props import EnumProperty, FloatProperty, PointerProperty, StringProperty

from .declared import ENCODINGS, GIVEN, PATH


class CalibrateSettings:
    """Photos of balls that tell where real lights are and how their colours mix."""

    ball: StringProperty(
        name="Mirror Ball",
        description="Photo of a mirror ball where the object stands, under the red, green and blue light at once",
        subtype="FILE_PATH",
        options=PATH,
    )
    second_ball: StringProperty(
        name="Second Place",
        description="Photo of the same ball at another place. With two places the lights' positions are found, "
        "not only their directions. Needs the lens",
        subtype="FILE_PATH",
        options=PATH,
    )
    ball_radius: FloatProperty(
        name="Ball Radius",
        description="Radius of the ball, in the unit that positions are wanted in: that of the mesh. "
        "It counts where lights have positions, for the grey ball too",
        default=1.0,
        min=1e-6,
        max=1e6,
        options=GIVEN,
    )
    grey: StringProperty(
        name="Grey Ball",
        description="Photo of a matt grey ball under the red, green and blue light at once",
        subtype="FILE_PATH",
        options=PATH,
    )
    lens: FloatProperty(
        name="Lens (mm)",
        description="Focal length in millimetres on a sensor 36 mm wide. 0: the camera is taken as far away",
        default=0.0,
        min=0.0,
        max=10000.0,
        options=GIVEN,
    )
    circle_x: FloatProperty(
        name="Ball X (px)",
        description="Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below",
        default=0.0,
        options=GIVEN,
    )
    circle_y: FloatProperty(
        name="Y (px)", description="Middle of the ball, in pixels from the photo's top edge", default=0.0, options=GIVEN
    )
    circle_radius: FloatProperty(
        name="Radius (px)",
        description="Radius of the ball's outline in pixels. 0: the ball is looked for",
        default=0.0,
        min=0.0,
        options=GIVEN,
    )
    second_x: FloatProperty(
        name="Second X (px)",
        description="Middle of the ball at its second place, in pixels from the photo's left edge",
        default=0.0,
        options=GIVEN,
    )
    second_y: FloatProperty(
        name="Y (px)",
        description="Middle of the ball at its second place, in pixels from the photo's top edge",
        default=0.0,
        options=GIVEN,
    )
    second_radius: FloatProperty(
        name="Radius (px)",
        description="Radius of the ball's outline at its second place, in pixels. Needed where the first one is given",
        default=0.0,
        min=0.0,
        options=GIVEN,
    )
    encoding: EnumProperty(
        name="Encoding",
        description="How the photos' values stand for light",
        items=ENCODINGS,
        default="AUTO",
        options=GIVEN,
    )
    output: StringProperty(
        name="Rig File",
        description="Rig file to write (.json). Empty: mpsnet_rig.json in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class MPS_PG_calibrate(CalibrateSettings, bpy.types.PropertyGroup):
    """Calibration: its photos, and what was found."""

    image: PointerProperty(name="Found", description="What was found, drawn over the photo", type=bpy.types.Image)
    told: StringProperty(name="Found", description="Table of what was found: lines of cells with | between them")
