"""Step 3: the estimate."""

from typing import Any

from ..settings.estimate import MODELS
from .models import MPS_MT_estimate_models, model_menu
from .step import Step


class MPS_PT_estimate(Step):
    bl_label = "3  Estimate"
    verbs = ("estimate",)

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.estimate.image

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        photo = context.scene.mps.photo.image
        moves = photo is not None and photo.source in {"SEQUENCE", "MOVIE"}
        model_menu(self.layout, estimate, MPS_MT_estimate_models)
        column = self.column()
        if estimate.model == "FILE":
            column.prop(estimate, "model_file")
        elif MODELS[estimate.model].passes and not moves:
            column.prop(estimate, "average_passes")
        column.prop(estimate, "file_format")
        column.prop(estimate, "output", text="Folder" if moves else "File", placeholder="Automatic")
        column.prop(estimate, "smooth" if moves else "confidence")
        if not moves:
            row = column.row()
            row.active = bool(estimate.white)
            row.prop(estimate, "albedo")
        self.progress_or(context, "estimate", "NORMALS_FACE")
        self.layout.template_ID(estimate, "image", open="image.open")
        self.picture(estimate.image)
        if estimate.albedo_image:
            self.layout.label(text="Albedo")
            self.picture(estimate.albedo_image)


CLASSES = (MPS_PT_estimate,)
