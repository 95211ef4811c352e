"""Step 5: heights over the photo, and on the object."""

from typing import Any

from ..scene.objects import target_of
from .bake import lacks_targets
from .photo_inputs import lacks_file
from .step import Step


class MPS_PT_heights(Step):
    bl_label = "5  Height"
    verbs = ("integrate",)
    shows = "heights"
    optional = True
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        normals = context.scene.mps.estimate.image
        if normals is not None and normals.source == "SEQUENCE":
            return "Heights are made of one photo's normals, and these are a sequence; estimate one photo"
        return super().lacks(context) or lacks_file(normals, "normal map")

    def draw(self, context: Any) -> None:
        heights = context.scene.mps.heights
        column = self.column()
        for name in ("method", "distance", "file_format"):
            column.prop(heights, name)
        column.prop(heights, "output", text="File", placeholder="Automatic")
        column = self.column(heading="Make")
        column.prop(heights, "mesh")
        if heights.mesh:
            column.prop(heights, "faces")
        for what in ("curvature", "occlusion", "relit"):
            column.prop(heights, what)
        self.progress_or(context, "integrate", "OUTLINER_DATA_LIGHTPROBE")
        self.picture(heights.image, folded="heights")


class MPS_PT_displace(Step):
    bl_label = "Displace Object"
    bl_parent_id = "MPS_PT_heights"
    verbs = ("displace",)
    shows = "displace"
    optional = True

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or lacks_targets(context, alone=True)

    def draw(self, context: Any) -> None:
        displace = context.scene.mps.displace
        target = target_of(context)
        column = self.column()
        column.prop(context.scene.mps.bake, "target", placeholder=target.name if target else "")
        column.prop(displace, "method")
        column.prop(displace, "levels")
        if displace.levels:
            column.prop(displace, "subdivision")
        for name in ("scale", "keep_normals", "file_format"):
            column.prop(displace, name)
        column.prop(displace, "output", text="File", placeholder="Automatic")
        self.progress_or(context, "displace", "MOD_DISPLACE")
        self.picture(displace.image, folded="displacement")
