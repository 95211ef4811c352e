"""Step 1 of rendered photos: the rig, lights and a camera in the scene."""

from typing import Any

from mpsnet_core.errors import InputError

from ..photo.camera import is_real
from ..rig.light_preview import light_preview
from ..rig.rig import last_evaluated_rig, rig_objects
from ..scene.surfaces import SURFACES
from .lights import light_table
from .photo_inputs import Lights, lights_of, virtual_rig
from .step import Kind, State, Step
from .text import across_sidebar, wrapped

# Types of objects that can have a surface.
_SURFACES = {*SURFACES, "EMPTY"}


class MPS_PT_rig(Step):
    bl_label = "1  Rig"
    way = "RENDER"
    verbs = ("add_rig",)

    @classmethod
    def result(cls, context: Any) -> Any:
        return bool(context.scene.mps.rig.lights)

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene, objects = context.scene, context.view_layer.objects
        if scene.mps.rig.lights:
            return ""
        if objects.active is not None and objects.active.mode != "OBJECT":
            return "Switch to Object Mode first"
        if any(obj.type in _SURFACES for obj in set(objects.selected) - set(rig_objects(scene))):
            return ""
        return "Select the object, then add the rig"

    @classmethod
    def state(cls, context: Any) -> State:
        if cls.result(context):
            try:
                last_evaluated_rig(context.scene)
            except InputError as error:
                return State(Kind.FAILED, str(error))
        return super().state(context)

    def draw(self, context: Any) -> None:
        scene, rig = context.scene, context.scene.mps.rig
        self.column(rig, "light_type", "slant", "tilt", "view")
        self.progress_or(context, "add_rig", "LIGHT", text="Replace Rig" if rig.lights else "Add Rig")
        if rig.lights and (error := _standing_lights(scene).lacks):
            wrapped(self.layout, error, icon="ERROR")
        if rig.lights:
            self._light_preview(context.scene)

    def _light_preview(self, scene: Any) -> None:
        preview = light_preview()
        self.layout.operator("mps.light_preview", icon="LIGHT_SUN", depress=preview is not None)
        self.failure(scene, "light_preview")
        if preview is None:
            return
        if preview.error:
            wrapped(self.layout, preview.error, icon="ERROR")
        row = self.layout.row()
        for icon in preview.icons.values():
            row.template_icon(icon_value=icon.icon_id, scale=across_sidebar() / 2)
        self.layout.label(text="Orange: two lights. Red: one. Black: none")


def _standing_lights(scene: Any) -> Lights:
    """The lights of the rig file, if it applies to the scene's photo, else those in the scene."""
    if is_real(scene.mps.photo.image) and (lights := lights_of(scene)).rig is not None:
        return lights
    return virtual_rig(scene)


class MPS_PT_rig_placement(Step):
    bl_label = "Placement"
    way = "RENDER"
    bl_parent_id = "MPS_PT_rig"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        self.layout.popover("MPS_PT_rig_presets", text="Presets", icon="PRESET")
        rig = context.scene.mps.rig
        self.column(rig, "distance", "light_size", "strength")
        self.column(rig, "projection", rig.projection == "PERSPECTIVE" and "focal_length", "margin")
        self.layout.operator("mps.add_rig_ring", icon="CON_FOLLOWPATH")
        self.failure(context.scene, "add_rig_ring")
        if rig.lights:
            lights = _standing_lights(context.scene)
            if lights.rig is not None:
                wrapped(self.layout, f"Lights: {lights.words}")
                light_table(self.layout, lights.rig)
            self.column().prop(rig, "camera", text="Taken By")
            row = self.layout.row(align=True)
            row.operator("mps.remove_rig", icon="TRASH")
            row.operator("mps.new_rig", icon="ADD")
