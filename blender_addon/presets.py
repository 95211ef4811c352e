"""User presets of a step's settings, which Blender stores in the user's folder, not in .blend files."""

from collections.abc import Iterable
from typing import Any

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from .settings.choices import choice_names


class _Presets(PresetPanel):
    preset_operator = "script.execute_preset"

    def path_menu(self, searchpaths: Iterable[str], operator: str, **options: Any) -> None:
        # An iterator is true even if it is empty: Blender would print a warning until the first preset exists.
        bpy.types.Menu.path_menu(self, iter(searchpaths), operator, **options)


class MPS_PT_rig_presets(_Presets, bpy.types.Panel):
    bl_label = "Rig Presets"
    preset_subdir = "mpsnet/rig"
    preset_add_operator = "mps.add_rig_preset"


class MPS_PT_bake_presets(_Presets, bpy.types.Panel):
    bl_label = "Bake Presets"
    preset_subdir = "mpsnet/bake"
    preset_add_operator = "mps.add_bake_preset"


class _AddPreset(AddPresetBase):
    step = ""

    @property
    def preset_defines(self) -> list[str]:
        return [f"settings = bpy.context.scene.mps.{self.step}"]

    @property
    def preset_values(self) -> list[str]:
        return [f"settings.{name}" for name in choice_names(getattr(bpy.context.scene.mps, self.step))]


class MPS_OT_add_rig_preset(_AddPreset, bpy.types.Operator):
    """Keep the rig's settings as a preset, or remove one"""

    bl_label = "Add Rig Preset"
    step, preset_menu, preset_subdir = "rig", "MPS_PT_rig_presets", MPS_PT_rig_presets.preset_subdir


class MPS_OT_add_bake_preset(_AddPreset, bpy.types.Operator):
    """Keep the bake's settings as a preset, or remove one; files and names are not kept"""

    bl_label = "Add Bake Preset"
    step, preset_menu, preset_subdir = "bake", "MPS_PT_bake_presets", MPS_PT_bake_presets.preset_subdir
