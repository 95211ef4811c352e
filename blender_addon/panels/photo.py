"""Step 2: the photo, its origin, and its mask."""

from typing import Any

import bpy

from mpsnet_core.errors import InputError, Note
from mpsnet_core.estimate.alignment.points import MIN_PAIRS

from ..child_process.trust import SCRIPTS_OFF
from ..image_records import made_by
from ..photo.camera import is_real
from ..photo.pick_points import picking
from ..rig.rig import last_evaluated_rig, rig_camera
from ..rig.rig_picture import rig_icon
from ..scene.camera import scene_camera
from ..settings.messages import in_blender
from ..settings.record import notes_of
from .photo_inputs import NEEDED_FILE, lacks_file, lacks_mask, lights_of
from .step import Step, target_name
from .text import across_sidebar, wrapped


class MPS_PT_photo(Step):
    bl_label = "Photo"
    verbs = ("open_photo", "render_photo")
    shows = "photo"
    codes = ("transfer-curve", "clipped-photo", "channels-alike", "black-channel", "no-mask", "doubtful-mask")

    @classmethod
    def verb(cls, context: Any) -> str:
        return "open_photo" if context.scene.mps.way == "PHOTOGRAPH" else "render_photo"

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene = context.scene
        if lacking := super().lacks(context):
            return lacking
        if cls.verb(context) == "open_photo":
            return ""
        try:
            last_evaluated_rig(scene)
            scene_camera(rig_camera(scene), scene)
        except InputError as error:
            return str(error)
        return ""

    def draw_header(self, context: Any) -> None:
        self.layout.label(text="1" if context.scene.mps.way == "PHOTOGRAPH" else "2")

    def draw(self, context: Any) -> None:
        photo, verb = context.scene.mps.photo, self.verb(context)
        if verb == "open_photo":
            row = self.layout.row()
            row.scale_y = 1.3
            row.template_ID(photo, "image", open="mps.open_photo")
            if photo.image is None:
                self.layout.template_icon(icon_value=rig_icon(), scale=across_sidebar())
        else:
            self._render(context, photo)
        for other in self.verbs:
            if other != verb:
                self.progress_of(context, other)
            if other != "render_photo" or verb != other:
                self.failure(context.scene, other)
        self.picture(photo.image)
        if verb == "open_photo" and photo.image is not None:
            self.progress_or(context, "check_photo", "VIEWZOOM")
            if is_real(photo.image):
                self.picture(context.scene.mps.align.image)

    def _render(self, context: Any, photo: Any) -> None:
        column = self.column()
        size = column.column(align=True)
        size.prop(photo, "width")
        size.prop(photo, "height")
        notes = [note for verb in ("render_photo", "render_truth") for note in notes_of(context.scene, verb)]
        column.prop(photo, "samples")
        column.prop(photo, "white")
        if any(SCRIPTS_OFF in note for note in notes) or bpy.app.autoexec_fail:
            column.prop(context.window_manager.mps, "run_scripts")
        self.progress_or(context, "render_photo", "RENDER_STILL")


class MPS_PT_render(Step):
    bl_label = "Animation and Files"
    way = "RENDER"
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        photo = context.scene.mps.photo
        column = self.column(photo, "animation")
        column.prop(photo, "output", text="Folder" if photo.animation else "File", placeholder="Automatic")
        if note := note_of_step(context.scene):
            wrapped(self.layout, note, icon="INFO")
        self.layout.template_ID(photo, "image", open="mps.open_photo")
        self.layout.operator("mps.look_through", icon="VIEW_CAMERA")


def note_of_step(scene: Any) -> str:
    """A sentence if all frames will be rendered although the scene has a frame step; otherwise ""."""
    if not scene.mps.photo.animation or scene.frame_step == 1:
        return ""
    words = "All frames are rendered. The scene's frame step of %d would leave gaps in the texture"
    return Note(words, scene.frame_step)


class MPS_PT_superpose(Step):
    bl_label = "Three Shots"
    way = "PHOTOGRAPH"
    verbs = ("superpose",)
    optional = True
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        image = context.scene.mps.photo.image
        return image if image and made_by(image) in cls.verbs else None

    @classmethod
    def lacks(cls, context: Any) -> str:
        settings = context.scene.mps.superpose
        if all((settings.first, settings.second, settings.third)):
            return ""
        return "Choose three photos, each under one white light from another side. Nothing but the light may move"

    def draw(self, context: Any) -> None:
        settings = context.scene.mps.superpose
        photos = dict.fromkeys(("first", "second", "third"), "Photo")
        self.column(settings, *photos, "encoding", "output", **photos)
        self.progress_or(context, "superpose", "IMAGE_RGB")


class MPS_PT_align(Step):
    bl_label = "Camera"
    way = "PHOTOGRAPH"
    verbs = ("align_photo",)
    optional = True
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return super().poll(context) and is_real(context.scene.mps.photo.image)

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene = context.scene
        photo = scene.mps.photo.image
        if lacking := super().lacks(context) or lacks_file(photo, "photo") or lights_of(scene).lacks:
            return lacking
        missing = MIN_PAIRS - len(photo.mps.pairs)
        fewer = 0 < missing < MIN_PAIRS
        return f"{MIN_PAIRS} points are the least: pick {missing} more, or remove them" if fewer else ""

    @classmethod
    def result(cls, context: Any) -> Any:
        photo = context.scene.mps.photo.image
        return bool(photo and photo.mps.fit)

    def draw(self, context: Any) -> None:
        photo, align = context.scene.mps.photo.image.mps, context.scene.mps.align
        self.column(context.scene.mps.bake, "target", target=target_name(context))
        column = self.column(photo, "camera")
        lens = context.scene.mps.estimate.lens
        column.prop(align, "lens_of", placeholder=f"{lens:g} mm" if lens else "Automatic")
        row = column.row()
        row.active = not photo.pairs
        row.prop(align, "start")
        for number, pair in enumerate(photo.pairs):
            row = self.layout.row()
            off = in_blender(Note("%.1f px off", pair.residual)) if pair.residual >= 0 else ""
            row.label(text=f"{number + 1}:  {pair.pixel[0]:.0f}, {pair.pixel[1]:.0f}  {off}")
            row.operator("mps.remove_align_point", text="", icon="X", emboss=False).index = number
        self.layout.operator("mps.pick_points", icon="CURSOR", depress=picking())
        self.progress_or(context, "align_photo", "CAMERA_DATA")
        if photo.fit:
            self.layout.operator("mps.look_through", icon="VIEW_CAMERA")


class MPS_PT_mask(Step):
    bl_label = "Mask"
    way = "PHOTOGRAPH"
    verbs = ("show_mask",)
    optional = True
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.estimate.mask_image

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or lacks_mask(context.scene.mps.estimate)

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        column = self.column(estimate, "mask", NEEDED_FILE.get(estimate.mask, ""))
        if estimate.mask == "THRESHOLD":
            column.prop(estimate, "threshold", slider=True)
        self.progress_or(context, "show_mask", "MOD_MASK")
        self.progress_or(context, "paint_mask", "BRUSH_DATA")
        self.picture(estimate.mask_image)


class MPS_PT_real(Step):
    bl_label = "Lens and Corrections"
    way = "PHOTOGRAPH"
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        self.column(context.scene.mps.estimate, "lens", "encoding", "dark", "flat", dark="None", flat="None")


class MPS_PT_colour(Step):
    bl_label = "Colour"
    way = "PHOTOGRAPH"
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        names = (bool(estimate.white) and "white_light", bool(estimate.white or estimate.albedo) and "albedo")
        self.column(estimate, "white", *names, white="None", white_light="Rig")
