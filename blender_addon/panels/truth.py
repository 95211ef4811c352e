"""The estimate compared with the true normals, which a rendered photo has."""

from typing import Any

from .step import Step


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
        self.picture(context.scene.mps.estimate.error_image, scale=12)


CLASSES = (MPS_PT_truth,)
