"""Many views."""

from typing import Any

from ..bake.many_views import background
from ..image_records import made_by
from ..outputs import is_safe_to_open
from .bake import lacks_base_map, lacks_targets, offer_anyway
from .photo_inputs import NO_LIGHTS
from .step import Step


class MPS_PT_views(Step):
    bl_label = "Many Views"
    verbs = ("bake_views",)
    optional = True
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        texture = context.scene.mps.bake.image
        return texture if texture is not None and made_by(texture) == "bake_views" else None

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene, views = context.scene, context.scene.mps.views
        if views.cameras and not views.photos:
            return "Choose the folder with the photos of these cameras"
        if not views.cameras and not any(background(obj) for obj in scene.objects):
            return "Give each camera its photo as background image, or choose what a photogrammetry program wrote"
        if not (scene.mps.estimate.rig_file or scene.mps.rig.lights):
            return NO_LIGHTS
        return lacks_targets(context) or lacks_base_map(context)

    def draw(self, context: Any) -> None:
        views = context.scene.mps.views
        files = ("photos", "axes") if views.cameras else ()
        names = ("cameras", *files, "white", "lights_in", "level", views.level and "level_scale", "keep")
        column = self.column(views, *names, cameras="This scene's", white="None", keep="Not kept")
        row = column.row()
        row.prop(views, "write_report")
        if views.report_file and is_safe_to_open(views.report_file):
            row.operator("wm.path_open", text="Open", icon="URL").filepath = views.report_file
        self.progress_or(context, "bake_views", "CAMERA_STEREO")
        offer_anyway(self.layout, context.scene, "bake_views")
        self.picture(self.result(context))
