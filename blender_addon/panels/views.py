"""Many views."""

from typing import Any

from .step import Step, wrapped


class MPS_PT_views(Step):
    bl_label = "Many Views"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        views = context.scene.mps.views
        column = self.column()
        column.prop(views, "cameras", placeholder="This scene's")
        if views.cameras:
            column.prop(views, "photos")
            column.prop(views, "axes")
        column.prop(views, "lights_in")
        column.prop(views, "level")
        if views.level:
            column.prop(views, "level_scale")
        column.prop(views, "keep", placeholder="Not kept")
        column.prop(views, "write_report")
        wrapped(self.layout.column(align=True), "Model as in 3 Estimate; target, size and file as in 4 Bake")
        self.progress_or(context, "bake_views", "CAMERA_STEREO")
        if views.report_file:
            self.layout.operator("wm.path_open", text="Open Report", icon="URL").filepath = views.report_file


CLASSES = (MPS_PT_views,)
