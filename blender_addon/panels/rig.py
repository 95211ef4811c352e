"""Step 1: the rig, either real lights from a file or a calibration, or lights and a camera in the scene."""

from typing import Any

from mpsnet_core.errors import InputError
from mpsnet_core.scene.rig import LightRig

from ..photo.camera import is_real
from ..photo.options import rig_file_for
from ..rig.light_preview import light_preview
from ..rig.light_rig import COLOURS, last_evaluated_rig
from ..rig.rig import rig_objects
from ..scene.surfaces import SURFACES
from ..settings.declared import OWN_SENSE
from .photo_inputs import Lights, lights_of, virtual_rig
from .step import Kind, State, Step, sentence
from .text import wrapped

# Types of objects that can have a surface.
_SURFACES = {*SURFACES, "EMPTY"}


class MPS_PT_rig(Step):
    bl_label = "1  Rig"
    verbs = ("add_rig",)

    @classmethod
    def result(cls, context: Any) -> Any:
        if context.scene.mps.way == "PHOTOGRAPH":
            return not lights_of(context.scene).lacks
        return bool(context.scene.mps.rig.lights)

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene, objects = context.scene, context.view_layer.objects
        if scene.mps.way == "PHOTOGRAPH":
            return lights_of(scene).lacks
        if scene.mps.rig.lights:
            return ""
        if objects.active is not None and objects.active.mode != "OBJECT":
            return "Switch to Object Mode first"
        if any(obj.type in _SURFACES for obj in set(objects.selected) - set(rig_objects(scene))):
            return ""
        return "Select the object, then add the rig"

    @classmethod
    def state(cls, context: Any) -> State:
        if context.scene.mps.way == "RENDER" and cls.result(context):
            try:
                last_evaluated_rig(context.scene)
            except InputError as error:
                return State(Kind.FAILED, str(error))
        return super().state(context)

    def draw(self, context: Any) -> None:
        self._rigs(context.scene.mps)
        if context.scene.mps.way == "PHOTOGRAPH":
            self._real(context.scene)
        else:
            self._virtual(context)

    def _real(self, scene: Any) -> None:
        estimate, photo = scene.mps.estimate, scene.mps.photo.image
        row = self.column().row()
        row.active = not estimate.rig_file or bool(rig_file_for(photo, estimate))
        row.prop(estimate, "rig_file", placeholder="Automatic")
        lights = lights_of(scene)
        if lights.lacks:
            wrapped(self.layout, sentence(lights.lacks), icon="INFO")
        elif lights.doubt:
            wrapped(self.layout, lights.doubt, icon="ERROR")
        if lights.rig is not None:
            _table(self.layout, lights.rig)

    def _virtual(self, context: Any) -> None:
        scene, rig = context.scene, context.scene.mps.rig
        self.column(rig, "light_type", "slant", "tilt", "view")
        self.progress_or(context, "add_rig", "LIGHT", text="Replace Rig" if rig.lights else "Add Rig")
        if rig.lights and (error := _standing_lights(scene).lacks):
            wrapped(self.layout, sentence(error), icon="ERROR")
        if rig.lights:
            self._light_preview(context.scene)

    def _light_preview(self, scene: Any) -> None:
        preview = light_preview()
        self.layout.operator("mps.light_preview", icon="LIGHT_SUN", depress=preview is not None)
        self.failure(scene, "light_preview")
        if preview is None:
            return
        header, body = self.foldable("light_preview")
        header.label(text="Photo and Normals")
        if preview.error:
            wrapped(self.layout, sentence(preview.error), icon="ERROR")
        if not body:
            return
        row = body.row()
        for icon in preview.icons.values():
            row.template_icon(icon_value=icon.icon_id, scale=6)
        body.label(text="Orange: two lights. Red: one. Black: none")

    def _rigs(self, mps: Any) -> None:
        """The list of several rigs, not shown for a single one."""
        if not mps.rigs:
            return
        column = self.layout.column(align=True)
        for number, one in enumerate(mps.rigs):
            row = column.row(align=True)
            chosen = number == mps.chosen_rig
            icon = "RADIOBUT_ON" if chosen else "RADIOBUT_OFF"
            row.operator("mps.choose_rig", text="" if chosen else one.name, icon=icon, depress=chosen).index = number
            if chosen:
                row.prop(one, "name", text="")
                row.operator("mps.drop_rig", text="", icon="REMOVE")
                row.operator("mps.new_rig", text="", icon="ADD")


def _standing_lights(scene: Any) -> Lights:
    """The lights of the rig file, if it applies to the scene's photo, else those in the scene."""
    if is_real(scene.mps.photo.image) and (lights := lights_of(scene)).rig is not None:
        return lights
    return virtual_rig(scene)


def _table(layout: Any, rig: LightRig) -> None:
    grid = layout.box().grid_flow(row_major=True, columns=4, even_columns=True)
    grid.scale_y = 0.8
    for text in ("", *COLOURS):
        grid.label(text=text)
    for text, angles in (("Slant", rig.slants), ("Tilt", rig.tilts)):
        grid.label(text=text, text_ctxt=OWN_SENSE)  # in Blender's own context, both would be the same in German
        for angle in angles:
            grid.label(text=f"{angle:.1f}°")


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
                self.layout.label(text=f"Lights: {lights.words}")
                _table(self.layout, lights.rig)
            self.column().prop(rig, "camera", text="Taken By")
            row = self.layout.row(align=True)
            row.operator("mps.remove_rig", icon="TRASH")
            row.operator("mps.new_rig", icon="ADD")


class MPS_PT_calibrate(Step):
    bl_label = "Calibrate Real Lights"
    way = "PHOTOGRAPH"
    verbs = ("calibrate_lights", "calibrate_mixing")
    shows = "calibrate"
    optional = True
    bl_parent_id = "MPS_PT_rig"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        if context.scene.mps.calibrate.ball:
            return ""
        return "Choose a photo of a mirror ball that stands in the object's place"

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        names = ("ball", "second_ball", "lens", "ball_radius", "encoding", "output")
        self.column(calibrate, *names, second_ball="For positions")
        self.progress_or(context, "calibrate_lights", "LIGHT_SUN")
        self.column(calibrate, "grey")
        self.progress_or(context, "calibrate_mixing", "COLOR", lacks=lacks_of_mixing(context.scene))
        if calibrate.summary:
            self._found(calibrate)

    def _found(self, calibrate: Any) -> None:
        self.picture(calibrate.image, scale=12)
        box = self.layout.box()
        rows = [line.split("|") for line in calibrate.summary.splitlines()]
        grid = box.grid_flow(row_major=True, columns=len(rows[0]), even_columns=True)
        for row in rows:
            # Table columns are too narrow for text.
            place = grid if len(row) == len(rows[0]) else box.split(factor=0.7)
            for text in row:
                place.label(text=text, text_ctxt=OWN_SENSE)


def lacks_of_mixing(scene: Any) -> str:
    """What is missing to calibrate the mixing; "" if nothing is."""
    if not scene.mps.estimate.rig_file:
        return "Find the lights first, or choose their rig file"
    return "" if scene.mps.calibrate.grey else "Choose a photo of a matt grey ball in the mirror ball's place"


class MPS_PT_outline(Step):
    bl_label = "Outline by Hand"
    bl_parent_id = "MPS_PT_calibrate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        for place in ("circle", "second") if calibrate.second_ball else ("circle",):
            self.column(calibrate, *(f"{place}_{what}" for what in ("x", "y", "radius")))
