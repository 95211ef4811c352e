"""Menus of selectable models. The settings have others, too, for scripts and for files that name them."""

from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..settings.estimate import MODELS

# Names in the menus. Other models have the same names as in evaluations and scripts.
NAMES = {"MULTISCALE": "Default", "MULTISCALE_QUICK": "Quick", "LAMBERTIAN": "Equation 2", "FILE": "File…"}


class _Models:
    bl_label = "Model"
    step = ""  # the step whose settings have the model
    also: tuple[str, ...] = ()  # listed in addition to the models that are not for comparison only

    def draw(self, context: Any) -> None:
        settings = getattr(context.scene.mps, self.step)
        for item in settings.bl_rna.properties["model"].enum_items:
            identifier = item.identifier
            if identifier in self.also or (identifier in MODELS and not MODELS[identifier].comparison):
                text = _name(settings, identifier)
                self.layout.prop_enum(settings, "model", identifier, text=text)  # type: ignore[attr-defined]


class MPS_MT_estimate_models(_Models, bpy.types.Menu):
    step = "estimate"
    also = ("FILE",)


class MPS_MT_material_models(_Models, bpy.types.Menu):
    step = "material"
    also = ("AUTO", "LAMBERTIAN_GREY_WORLD")


def model_menu(layout: Any, settings: Any, menu: type[_Models]) -> None:
    """The menu as a button over the full width, because some names are longer than half a panel."""
    layout.menu(menu.__name__, text=f"{iface('Model')}: {iface(_name(settings, settings.model))}", translate=False)


def _name(settings: Any, model: str) -> str:
    return NAMES.get(model) or str(settings.bl_rna.properties["model"].enum_items[model].name)
