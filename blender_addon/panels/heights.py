"""Step 5: heights over the photo, and on the object."""

from typing import Any

from .bake import lacks_targets
from .photo_inputs import lacks_file
from .step import Step, target_name


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
        self.column(heights, "method", "distance", "file_format", "output")
        self.column(heights, "mesh", heights.mesh and "faces", "curvature", "occlusion", "relit", heading="Make")
        self.progress_or(context, "integrate", "OUTLINER_DATA_LIGHTPROBE")
        self.picture(heights.image)


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
        self.column(context.scene.mps.bake, "target", target=target_name(context))
        manual = not displace.automatic
        subdivision = bool(displace.automatic or displace.levels) and "subdivision"
        chosen = ("method", "automatic", manual and "levels", subdivision, manual and "scale")
        self.column(displace, *chosen, "keep_normals", "file_format", "output")
        self.progress_or(context, "displace", "MOD_DISPLACE")
        self.picture(displace.image)
