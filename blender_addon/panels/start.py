"""Where a newcomer begins: one button that shows all of it."""

from typing import Any

from .step import Step


class MPS_PT_start(Step):
    bl_label = "Start"
    bl_options = {"HIDE_HEADER"}

    def draw(self, context: Any) -> None:
        self.progress_or(context, "try_it", "PLAY")


CLASSES = (MPS_PT_start,)
