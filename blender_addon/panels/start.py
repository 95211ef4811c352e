"""The start: the choice of a way to a photo, and a button for newcomers that shows all steps."""

from typing import Any

from ..settings.record import error_of
from ..start.try_it import scene_before
from .step import Step


class MPS_PT_start(Step):
    bl_label = "Start"
    bl_options = {"HIDE_HEADER"}

    def draw(self, context: Any) -> None:
        row = self.layout.row()
        row.scale_y = 1.3
        row.prop(context.scene.mps, "way", expand=True)
        mps = context.scene.mps
        self._rigs(mps)
        if mps.way == "PHOTOGRAPH":
            self.progress_or(context, "scan", "SHADERFX")
        begun = mps.photo.image or mps.rig.lights or mps.estimate.rig_file
        if not begun or context.window_manager.mps.chain == "MPS_OT_try_it" or error_of(context.scene, "try_it"):
            self.progress_or(context, "try_it", "PLAY")
        if scene_before(context.scene) is not None:
            self.layout.operator("mps.back_to_scene", icon="LOOP_BACK")

    def _rigs(self, mps: Any) -> None:
        """The list of several rigs, not shown for a single one."""
        column = self.layout.column(align=True)
        for number, one in enumerate(mps.rigs if len(mps.rigs) > 1 else ()):
            row = column.row(align=True)
            chosen = number == mps.chosen_rig
            icon = "RADIOBUT_ON" if chosen else "RADIOBUT_OFF"
            row.operator("mps.choose_rig", text="" if chosen else one.name, icon=icon, depress=chosen).index = number
            if chosen:
                row.prop(one, "name", text="")
                row.operator("mps.drop_rig", text="", icon="REMOVE")
                row.operator("mps.new_rig", text="", icon="ADD")
