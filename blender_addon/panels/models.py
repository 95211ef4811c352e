"""Menus of models: those to choose from. The settings hold the others too, for scripts and for files that name them."""

from typing import Any

import bpy

from ..settings.estimate import MODELS


class _Models:
    bl_label = "Model"
    step = ""  # whose settings have the model
    also: tuple[str, ...] = ()  # besides those that are not for comparison

    def draw(self, context: Any) -> None:
        settings = getattr(context.scene.mps, self.step)
        for item in settings.bl_rna.properties["model"].enum_items:
            identifier = item.identifier
            if identifier in self.also or (identifier in MODELS and not MODELS[identifier].comparison):
                self.layout.prop_enum(settings, "model", identifier)  # type: ignore[attr-defined]


class MPS_MT_estimate_models(_Models, bpy.types.Menu):
    step = "estimate"
    also = ("FILE",)


class MPS_MT_material_models(_Models, bpy.types.Menu):
    step = "material"
    also = ("LAMBERTIAN_GREY_WORLD",)


def model_menu(layout: Any, settings: Any, menu: type[_Models]) -> None:
    """The menu as a button over the layout's whole width, for its names are longer than half a panel."""
    layout.menu(menu.__name__, text=settings.bl_rna.properties["model"].enum_items[settings.model].name)


CLASSES = (MPS_MT_estimate_models, MPS_MT_material_models)
