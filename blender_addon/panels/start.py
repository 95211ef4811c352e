"""The start: the choice of a way to a photo, and a button for newcomers that shows all steps."""

from typing import Any

from ..settings.record import error_of
from .step import Step


class MPS_PT_start(Step):
    bl_label = "Start"
    bl_options = {"HIDE_HEADER"}

    def draw(self, context: Any) -> None:
        row = self.layout.row()
        row.scale_y = 1.3
        row.prop(context.scene.mps, "way", expand=True)
        mps = context.scene.mps
        begun = mps.photo.image or mps.rig.lights or mps.estimate.rig_file
        if not begun or context.window_manager.mps.running == "MPS_OT_try_it" or error_of(context.scene, "try_it"):
            self.progress_or(context, "try_it", "PLAY")
