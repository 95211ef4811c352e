"""What the panels of the sidebar share."""

from typing import Any

import bpy


class Step(bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "MPS"

    def column(self, *, heading: str = "") -> Any:
        column = self.layout.column(heading=heading)
        column.use_property_split = True
        column.use_property_decorate = False
        return column

    def progress_or(self, context: Any, verb: str, icon: str) -> None:
        """The step's button, or while its work runs the progress and a way to stop it."""
        job = context.window_manager.mps
        if job.running != f"MPS_OT_{verb}":
            self.layout.operator(f"mps.{verb}", icon=icon)
            return
        row = self.layout.row(align=True)
        row.progress(factor=job.progress, text=sentence(job.message))
        row.operator("mps.cancel", text="", icon="X")

    def picture(self, image: Any, scale: float = 8) -> None:
        if image is not None:
            self.layout.template_icon(icon_value=image.preview_ensure().icon_id, scale=scale)


def sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def wrapped(layout: Any, sentence: str, width: int = 36) -> None:
    """A sentence over several labels: Blender cuts a label off where the panel ends."""
    line = ""
    for word in sentence.split():
        if line and len(line) + len(word) >= width:
            layout.label(text=line)
            line = ""
        line = f"{line} {word}".strip()
    layout.label(text=line)
