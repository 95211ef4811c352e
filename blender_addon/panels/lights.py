"""Step 2 of real photos: their lights, from a file, a calibration or the photo itself."""

from typing import Any

from mpsnet_core.errors import Note
from mpsnet_core.scene.rig import LightRig

from ..photo.find_lights import from_ball, places_of_ball
from ..photo.options import rig_file_for
from ..rig.rig import COLOURS
from ..settings.messages import OWN_SENSE
from .photo_inputs import lights_of
from .step import Step, target_name
from .text import wrapped

NO_RIG = "No rig needed: the photo shows its lights"


class MPS_PT_lights(Step):
    bl_label = "2  Lights"
    way = "PHOTOGRAPH"
    verbs = ("calibrate_lights", "calibrate_mixing")
    codes = ("lights-found", "wrong-rig", "room-light", "unknown-mixing")
    optional = True

    @classmethod
    def result(cls, context: Any) -> Any:
        return lights_of(context.scene).rig is not None

    @classmethod
    def lacks(cls, context: Any) -> str:
        return lights_of(context.scene).lacks

    def draw(self, context: Any) -> None:
        scene = context.scene
        estimate, photo, lights = scene.mps.estimate, scene.mps.photo.image, lights_of(scene)
        row = self.column().row()
        row.active = not estimate.rig_file or bool(rig_file_for(photo, estimate))
        self.field(row, estimate, "rig_file", placeholder="Automatic")
        doubts = [Note(text, level="look") for text in (lights.lacks, lights.doubt) if text]
        self.told(context, "lights", doubts)
        if lights.error is not None:
            wrapped(self.layout, NO_RIG, icon="INFO")
        if lights.rig is not None:
            light_table(self.layout, lights.rig)


class MPS_PT_calibrate(Step):
    bl_label = "Find Lights"
    way = "PHOTOGRAPH"
    verbs = ("calibrate_lights", "calibrate_mixing")
    optional = True
    bl_parent_id = "MPS_PT_lights"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        calibrate = context.scene.mps.calibrate
        return calibrate.image or bool(calibrate.summary)

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        self.layout.row().prop(calibrate, "source", expand=True)
        if calibrate.source == "MESH":
            self.column(context.scene.mps.bake, "target", target=target_name(context))
        lamps = calibrate.source == "LAMPS"
        if lamps:
            self.field(self.column(), calibrate, "ball", text="First Light")
        photos = ("second_light", "third_light") if lamps else ("ball", "second_ball")
        ball = (*photos, "lens", "ball_radius", "encoding") if from_ball(calibrate) else ()
        self.column(calibrate, *ball, "output", second_ball="For positions")
        self.progress_or(context, "calibrate_lights", "LIGHT_SUN")
        if from_ball(calibrate):
            self.column(calibrate, "grey")
            self.progress_or(context, "calibrate_mixing", "COLOR", lacks=lacks_of_mixing(context.scene))
        if calibrate.summary:
            self._found(calibrate)

    def _found(self, calibrate: Any) -> None:
        self.picture(calibrate.image)
        box = self.layout.box()
        rows = [line.split("|") for line in calibrate.summary.splitlines()]
        grid = box.grid_flow(row_major=True, columns=len(rows[0]), even_columns=True)
        for row in rows:
            # Table columns are too narrow for text.
            place = grid if len(row) == len(rows[0]) else box.split(factor=0.7)
            for text in row:
                place.label(text=text, text_ctxt=OWN_SENSE)


def lacks_of_mixing(scene: Any) -> str:
    """What is missing to calibrate the mixing; "" if nothing is."""
    if not scene.mps.estimate.rig_file:
        return "Find the lights first, or choose their rig file"
    return "" if scene.mps.calibrate.grey else "Choose a photo of a matt grey ball in the mirror ball's place"


class MPS_PT_outline(Step):
    bl_label = "Outline by Hand"
    bl_parent_id = "MPS_PT_calibrate"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return from_ball(context.scene.mps.calibrate)

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        for place in ("circle", "second")[: places_of_ball(calibrate)]:
            self.column(calibrate, *(f"{place}_{what}" for what in ("x", "y", "radius")))


def light_table(layout: Any, rig: LightRig) -> None:
    grid = layout.box().grid_flow(row_major=True, columns=4, even_columns=True)
    grid.scale_y = 0.8
    for text in ("", *COLOURS):
        grid.label(text=text)
    for text, angles in (("Slant", rig.slants), ("Tilt", rig.tilts)):
        grid.label(text=text, text_ctxt=OWN_SENSE)  # in Blender's own context, both would be the same in German
        for angle in angles:
            grid.label(text=f"{angle:.1f}°")
