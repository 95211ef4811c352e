"""Step 1: the rig, and the calibration of real lights."""

from typing import Any

from mpsnet_core.errors import InputError

from ..rig.rig import COLOURS, drawn_rig
from .step import Kind, State, Step, sentence
from .text import wrapped


class MPS_PT_rig(Step):
    bl_label = "1  Rig"
    verbs = ("add_rig",)

    @classmethod
    def result(cls, context: Any) -> Any:
        return bool(context.scene.mps.rig.lights)

    @classmethod
    def lacks(cls, context: Any) -> str:
        if cls.result(context) or context.view_layer.objects.selected:
            return super().lacks(context)
        return "Select the object, then add the rig. A photo that you took needs none"

    @classmethod
    def state(cls, context: Any) -> State:
        if cls.result(context):
            try:
                drawn_rig(context.scene)
            except InputError as error:
                return State(Kind.FAILED, str(error))
        return super().state(context)

    def draw(self, context: Any) -> None:
        rig = context.scene.mps.rig
        self._rigs(context.scene.mps)
        self.layout.popover("MPS_PT_rig_presets", text="Presets", icon="PRESET")
        column = self.column()
        column.prop(rig, "light_type")
        column.prop(rig, "slant")
        column.prop(rig, "tilt")
        column.prop(rig, "distance")
        column.prop(rig, "light_size")
        column.prop(rig, "strength")
        column = self.column()
        column.prop(rig, "projection")
        if rig.projection == "PERSPECTIVE":
            column.prop(rig, "focal_length")
        column.prop(rig, "view")
        column.prop(rig, "margin")
        self.progress_or(context, "add_rig", "LIGHT", text="Replace Rig" if rig.lights else "Add Rig")
        self.layout.operator("mps.add_rig_ring", icon="CON_FOLLOWPATH")
        if rig.lights:
            self._standing(context.scene)
            self.column().prop(rig, "camera", text="Taken By")
            row = self.layout.row(align=True)
            row.operator("mps.remove_rig", icon="TRASH")
            row.operator("mps.new_rig", icon="ADD")

    def _rigs(self, mps: Any) -> None:
        """The list of several rigs; one alone needs none."""
        if not mps.rigs:
            return
        column = self.layout.column(align=True)
        for number, one in enumerate(mps.rigs):
            row = column.row(align=True)
            chosen = number == mps.chosen_rig
            icon = "RADIOBUT_ON" if chosen else "RADIOBUT_OFF"
            row.operator("mps.choose_rig", text="" if chosen else one.name, icon=icon, depress=chosen).index = number
            if chosen:
                row.prop(one, "name", text="")
                row.operator("mps.drop_rig", text="", icon="REMOVE")
                row.operator("mps.new_rig", text="", icon="ADD")

    def _standing(self, scene: Any) -> None:
        box = self.layout.box().column(align=True)
        try:
            lights = drawn_rig(scene)
        except InputError as error:
            wrapped(box, sentence(str(error)), icon="ERROR")
            return
        grid = box.grid_flow(row_major=True, columns=3, even_columns=True)
        for heading in ("", "Slant", "Tilt"):
            grid.label(text=heading)
        for colour, slant, tilt in zip(COLOURS, lights.slants, lights.tilts, strict=True):
            grid.label(text=colour)
            grid.label(text=f"{slant:.1f}°")
            grid.label(text=f"{tilt:.1f}°")


class MPS_PT_calibrate(Step):
    bl_label = "Calibrate Real Lights"
    verbs = ("calibrate_lights", "calibrate_mixing")
    optional = True
    bl_parent_id = "MPS_PT_rig"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.calibrate.image

    @classmethod
    def lacks(cls, context: Any) -> str:
        if context.scene.mps.calibrate.ball:
            return ""
        return "Choose a photo of a mirror ball that stands in the object's place"

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        column = self.column()
        column.prop(calibrate, "ball")
        column.prop(calibrate, "second_ball", placeholder="For positions")
        column.prop(calibrate, "lens")
        column.prop(calibrate, "ball_radius")
        column.prop(calibrate, "encoding")
        column.prop(calibrate, "output", placeholder="Automatic")
        self.progress_or(context, "calibrate_lights", "LIGHT_SUN")
        self.column().prop(calibrate, "grey")
        self.progress_or(context, "calibrate_mixing", "COLOR")
        if calibrate.told:
            self._found(calibrate)

    def _found(self, calibrate: Any) -> None:
        self.picture(calibrate.image, scale=12)
        box = self.layout.box()
        rows = [line.split("|") for line in calibrate.told.splitlines()]
        grid = box.grid_flow(row_major=True, columns=len(rows[0]), even_columns=True)
        for row in rows:
            for text in row:
                grid.label(text=text)


class MPS_PT_outline(Step):
    bl_label = "Outline by Hand"
    bl_parent_id = "MPS_PT_calibrate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        for place in ("circle", "second") if calibrate.second_ball else ("circle",):
            column = self.column()
            for what in ("x", "y", "radius"):
                column.prop(calibrate, f"{place}_{what}")


CLASSES = (
    MPS_PT_rig,
    MPS_PT_calibrate,
    MPS_PT_outline,
)
