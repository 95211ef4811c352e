"""The viewport's menu Object > MPS-Net. Blender's search (F3) only finds operators that are in a menu."""

from typing import Any

import bpy

from . import panels


class MPS_MT_steps(bpy.types.Menu):
    bl_label = "MPS-Net"

    def draw(self, context: Any) -> None:
        for verb in verbs():
            self.layout.operator(f"mps.{verb}")


def verbs() -> list[str]:
    """Every operator that makes sense on its own: those of the steps in the sidebar's order, then the others."""
    steps = [verb for panel in panels.CLASSES for verb in getattr(panel, "verbs", ())]
    every = [verb for verb in dir(bpy.ops.mps) if "INTERNAL" not in getattr(bpy.types, f"MPS_OT_{verb}").bl_options]
    return list(dict.fromkeys([*steps, *every]))


def _in_object_menu(self: Any, context: Any) -> None:
    self.layout.separator()
    self.layout.menu("MPS_MT_steps")


def register() -> None:
    bpy.types.VIEW3D_MT_object.append(_in_object_menu)


def unregister() -> None:
    bpy.types.VIEW3D_MT_object.remove(_in_object_menu)
