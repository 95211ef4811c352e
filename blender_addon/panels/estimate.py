"""Step 3: the estimate, and its comparison with the true normals, which a rendered photo has."""

from typing import Any

from mpsnet_core.errors import Note
from mpsnet_core.estimate.registry import STILL_PASSES

from ..settings.estimate import MODELS
from .models import MPS_MT_estimate_models, model_menu
from .photo_inputs import camera_of, lacks_of_estimate, lights_of
from .step import Step
from .text import wrapped


class MPS_PT_estimate(Step):
    bl_label = "3  Estimate"
    verbs = ("estimate",)
    shows = "estimate"

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or lacks_of_estimate(context.scene)

    def draw(self, context: Any) -> None:
        scene, estimate = context.scene, context.scene.mps.estimate
        model_menu(self.layout, estimate, MPS_MT_estimate_models)
        if estimate.model == "FILE":
            self.column(estimate, "model_file")
        if scene.mps.photo.image is not None:
            lines = self.layout.column(align=True)
            lines.scale_y = 0.9
            wrapped(lines, f"Lights: {lights_of(scene).words}")
            wrapped(lines, Note("Camera: %s", camera_of(scene) or Note("far away, no lens known")))
        self.progress_or(context, "estimate", "NORMALS_FACE")
        self.picture(estimate.image)
        if estimate.albedo_image:
            self.picture(estimate.albedo_image)


class MPS_PT_estimate_options(Step):
    bl_label = "Options"
    bl_parent_id = "MPS_PT_estimate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        photo = context.scene.mps.photo.image
        moves = photo is not None and photo.source in {"SEQUENCE", "MOVIE"}
        averages = not moves and estimate.model != "FILE" and MODELS[estimate.model].passes == STILL_PASSES
        column = self.column(estimate, averages and "average_passes", "file_format")
        column.prop(estimate, "output", text="Folder" if moves else "File", placeholder="Automatic")
        column.prop(estimate, "smooth" if moves else "confidence")
        column = self.column()
        column.label(text="Near Lights")
        column.prop(estimate, "surface", placeholder="None")
        column.prop(estimate, "distance")
        self.layout.template_ID(estimate, "image", open="image.open")


class MPS_PT_truth(Step):
    bl_label = "Compare with the Truth"
    way = "RENDER"
    bl_parent_id = "MPS_PT_estimate"
    bl_options = {"DEFAULT_CLOSED"}
    verbs = ("error_map", "render_truth")
    optional = True

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.estimate.error_image

    def draw(self, context: Any) -> None:
        self.progress_or(context, "render_truth", "NORMALS_VERTEX", text="True Normals")
        self.progress_or(context, "error_map", "IMAGE_DATA")
        self.picture(context.scene.mps.estimate.error_image)
