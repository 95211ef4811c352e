"""Flat materials."""

from typing import Any

from .models import MPS_MT_material_models, model_menu
from .step import Step
from .text import wrapped


class MPS_PT_material(Step):
    bl_label = "Flat Material"
    verbs = ("make_material",)
    optional = True
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.material.image

    def draw(self, context: Any) -> None:
        material = context.scene.mps.material
        model_menu(self.layout, material, MPS_MT_material_models)
        column = self.column()
        column.prop(material, "width")
        column.prop(material, "size")
        column.prop(material, "overlap")
        column.prop(material, "bend")
        column.prop(material, "grey")
        column.prop(material, "relief")
        column.prop(material, "repeats")
        column.prop(material, "output", placeholder="Automatic")
        wrapped(self.layout, "Photo, rig and lens as in 2 Photo")
        self.progress_or(context, "make_material", "MATERIAL")
        if material.told:
            wrapped(self.layout, material.told)
        self.picture(material.image, scale=12)


class MPS_PT_material_crop(Step):
    bl_label = "Crop"
    bl_parent_id = "MPS_PT_material"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        material = context.scene.mps.material
        column = self.column().column(align=True)
        for side in ("left", "right", "top", "bottom"):
            column.prop(material, f"crop_{side}")


CLASSES = (MPS_PT_material, MPS_PT_material_crop)
