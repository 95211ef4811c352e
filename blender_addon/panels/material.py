"""Flat materials."""

from typing import Any

from ..image_records import remembered
from .models import MPS_MT_material_models, model_menu
from .photo_inputs import NO_LIGHTS, lacks_file, lights_of
from .step import Step
from .text import wrapped


class MPS_PT_material(Step):
    bl_label = "Flat Material"
    verbs = ("make_material",)
    shows = "material"
    optional = True
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        photo = context.scene.mps.photo.image
        if photo is not None and photo.source in {"SEQUENCE", "MOVIE"}:
            return "A flat material is made of one photo, and this is a sequence; open one of its frames"
        lights = lights_of(context.scene)
        lacking = super().lacks(context) or lacks_file(photo, "photo") or lights.lacks
        if not lacking and lights.error is not None:
            return NO_LIGHTS
        if not lacking and not context.scene.mps.material.width and remembered(photo, "camera") is None:
            return "Enter the photo width: what the whole photo measures on the material"
        return lacking

    def draw(self, context: Any) -> None:
        material = context.scene.mps.material
        model_menu(self.layout, material, MPS_MT_material_models)
        self.column(material, "width", "size", "overlap", "bend", "grey", "relief", "repeats", "output")
        self.progress_or(context, "make_material", "MATERIAL")
        if material.summary:
            wrapped(self.layout, material.summary)
        self.picture(material.image)


class MPS_PT_material_crop(Step):
    bl_label = "Crop"
    bl_parent_id = "MPS_PT_material"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        material = context.scene.mps.material
        column = self.column().column(align=True)
        for side in ("left", "right", "top", "bottom"):
            column.prop(material, f"crop_{side}")
