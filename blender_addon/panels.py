"""The sidebar's tab "MPS": the four steps from top to bottom, and training data."""

from typing import Any

import bpy

from mpsnet_core.errors import InputError

from .outputs import lasting
from .rig import COLOURS, drawn_rig
from .training_data import samples_folder, standing


class _Step(bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "MPS"

    def column(self, *, heading: str = "") -> Any:
        column = self.layout.column(heading=heading)
        column.use_property_split = True
        column.use_property_decorate = False
        return column

    def progress_or(self, context: Any, verb: str, icon: str) -> None:
        """The step's button, or while its work runs the progress and a way to stop it."""
        job = context.window_manager.mps
        if job.running != f"MPS_OT_{verb}":
            self.layout.operator(f"mps.{verb}", icon=icon)
            return
        row = self.layout.row(align=True)
        row.progress(factor=job.progress, text=_sentence(job.message))
        row.operator("mps.cancel", text="", icon="X")

    def picture(self, image: Any, scale: float = 8) -> None:
        if image is not None:
            self.layout.template_icon(icon_value=image.preview_ensure().icon_id, scale=scale)


class MPS_PT_rig(_Step):
    bl_label = "1  Rig"

    def draw(self, context: Any) -> None:
        rig = context.scene.mps.rig
        column = self.column()
        column.prop(rig, "light_type")
        column.prop(rig, "slant")
        column.prop(rig, "tilt")
        column.prop(rig, "distance")
        column.prop(rig, "light_size")
        column.prop(rig, "strength")
        column = self.column()
        column.prop(rig, "projection")
        if rig.projection == "PERSPECTIVE":
            column.prop(rig, "focal_length")
        column.prop(rig, "view")
        column.prop(rig, "margin")
        row = self.layout.row(align=True)
        row.operator("mps.add_rig", text="Replace Rig" if rig.lights else "Add Rig", icon="LIGHT")
        if rig.lights:
            row.operator("mps.remove_rig", text="", icon="TRASH")
            self._standing(context.scene)

    def _standing(self, scene: Any) -> None:
        box = self.layout.box().column(align=True)
        try:
            lights = drawn_rig(scene)
        except InputError as error:
            _wrapped(box, str(error))
            return
        grid = box.grid_flow(row_major=True, columns=3, even_columns=True)
        for heading in ("", "Slant", "Tilt"):
            grid.label(text=heading)
        for colour, slant, tilt in zip(COLOURS, lights.slants, lights.tilts, strict=True):
            grid.label(text=colour)
            grid.label(text=f"{slant:.1f}°")
            grid.label(text=f"{tilt:.1f}°")


class MPS_PT_calibrate(_Step):
    bl_label = "Calibrate Real Lights"
    bl_parent_id = "MPS_PT_rig"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        column = self.column()
        column.prop(calibrate, "ball")
        column.prop(calibrate, "second_ball", placeholder="For positions")
        column.prop(calibrate, "lens")
        column.prop(calibrate, "ball_radius")
        column.prop(calibrate, "encoding")
        column.prop(calibrate, "output", placeholder="Automatic")
        self.progress_or(context, "calibrate_lights", "LIGHT_SUN")
        self.column().prop(calibrate, "grey")
        self.progress_or(context, "calibrate_mixing", "COLOR")
        if calibrate.told:
            self._found(calibrate)

    def _found(self, calibrate: Any) -> None:
        self.picture(calibrate.image, scale=12)
        box = self.layout.box()
        rows = [line.split("|") for line in calibrate.told.splitlines()]
        grid = box.grid_flow(row_major=True, columns=len(rows[0]), even_columns=True)
        for row in rows:
            for text in row:
                grid.label(text=text)
        for note in calibrate.notes.splitlines():
            _wrapped(box.column(align=True), _sentence(note))


class MPS_PT_outline(_Step):
    bl_label = "Outline by Hand"
    bl_parent_id = "MPS_PT_calibrate"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        calibrate = context.scene.mps.calibrate
        for place in ("circle", "second") if calibrate.second_ball else ("circle",):
            column = self.column()
            for what in ("x", "y", "radius"):
                column.prop(calibrate, f"{place}_{what}")


class MPS_PT_photo(_Step):
    bl_label = "2  Photo"

    def draw(self, context: Any) -> None:
        photo = context.scene.mps.photo
        column = self.column()
        size = column.column(align=True)
        size.prop(photo, "width")
        size.prop(photo, "height")
        column.prop(photo, "samples")
        column.prop(photo, "output", text="File", placeholder="Automatic")
        self.layout.operator("mps.render_photo", icon="RENDER_STILL")
        self.layout.template_ID(photo, "image", open="mps.open_photo")
        self.picture(photo.image)


class MPS_PT_real(_Step):
    bl_label = "Real Photo"
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        column = self.column()
        column.prop(estimate, "rig_file", placeholder="Automatic")
        column.prop(estimate, "lens")
        column.prop(estimate, "encoding")
        column.prop(estimate, "dark", placeholder="None")
        column.prop(estimate, "flat", placeholder="None")


class MPS_PT_near(_Step):
    bl_label = "Near Lights"
    bl_parent_id = "MPS_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        column = self.column()
        column.prop(estimate, "surface", placeholder="None")
        column.prop(estimate, "distance")


class MPS_PT_mask(_Step):
    bl_label = "Mask"
    bl_parent_id = "MPS_PT_photo"

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        column = self.column()
        column.prop(estimate, "mask")
        if estimate.mask == "FILE":
            column.prop(estimate, "mask_file")
        elif estimate.mask == "BACKGROUND":
            column.prop(estimate, "background")
        elif estimate.mask == "THRESHOLD":
            column.prop(estimate, "threshold", slider=True)
        self.progress_or(context, "show_mask", "MOD_MASK")
        self.picture(estimate.mask_image, scale=12)


class MPS_PT_estimate(_Step):
    bl_label = "3  Estimate"

    def draw(self, context: Any) -> None:
        estimate = context.scene.mps.estimate
        column = self.column()
        column.prop(estimate, "model")
        if estimate.model == "FILE":
            column.prop(estimate, "model_file")
        column.prop(estimate, "file_format")
        photo = context.scene.mps.photo.image
        moves = photo is not None and photo.source in {"SEQUENCE", "MOVIE"}
        column.prop(estimate, "output", text="Folder" if moves else "File", placeholder="Automatic")
        column.prop(estimate, "smooth" if moves else "confidence")
        self.progress_or(context, "estimate", "NORMALS_FACE")
        self.layout.template_ID(estimate, "image", open="image.open")
        self.picture(estimate.image)


class MPS_PT_bake(_Step):
    bl_label = "4  Bake"

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        target = bake.target or context.view_layer.objects.active
        column = self.column()
        column.prop(bake, "target", placeholder=target.name if target else "")
        if target is not None and target.type == "MESH":
            column.prop_search(bake, "uv_map", target.data, "uv_layers")
        else:
            column.prop(bake, "uv_map")
        column.prop(bake, "size")
        column.prop(bake, "space")
        column.prop(bake, "convention")
        column.prop(bake, "margin")
        column.prop(bake, "file_format")
        column.prop(bake, "output", text="File", placeholder="Automatic")
        normals = context.scene.mps.estimate.image
        if normals is not None and normals.source == "SEQUENCE":
            column.prop(bake, "animated")
        self.progress_or(context, "bake", "TEXTURE")
        self.layout.template_ID(bake, "image", open="image.open")
        self.picture(bake.image)


class MPS_PT_views(_Step):
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
        _wrapped(self.layout.column(align=True), "Model as in 3 Estimate; target, size and file as in 4 Bake")
        self.progress_or(context, "bake_views", "CAMERA_STEREO")
        if views.report_file:
            self.layout.operator("wm.path_open", text="Open Report", icon="URL").filepath = views.report_file


class MPS_PT_samples(_Step):
    bl_label = "Training Data"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        samples = context.scene.mps.samples
        column = self.column()
        column.prop(samples, "source")
        if samples.source == "GENERATED":
            column.prop(samples, "kinds")
        elif samples.source == "MESHES":
            column.prop(samples, "meshes")
        column = self.column()
        column.prop(samples, "count")
        column.prop(samples, "seed")
        column.prop(samples, "size")
        if samples.source != "SCENE":
            column.prop(samples, "views")
        column = self.column()
        column.prop(samples, "samples")
        column.prop(samples, "bounces")
        column.prop(samples, "denoise")
        column = self.column()
        target = samples_folder(context.scene)
        column.prop(samples, "output", placeholder="Automatic" if lasting(target) else "Name one")
        column.prop(samples, "processes")
        column.prop(samples, "cluster", placeholder="This machine")
        self.progress_or(context, "render_samples", "RENDER_ANIMATION")
        found = standing(target)
        if found and not context.window_manager.mps.running:
            self.layout.label(text=f"{found} in this folder")
        self.picture(samples.image, scale=12)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _wrapped(layout: Any, sentence: str, width: int = 36) -> None:
    """A sentence over several labels: Blender cuts a label off where the panel ends."""
    line = ""
    for word in sentence.split():
        if line and len(line) + len(word) >= width:
            layout.label(text=line)
            line = ""
        line = f"{line} {word}".strip()
    layout.label(text=line)


CLASSES = (
    MPS_PT_rig,
    MPS_PT_calibrate,
    MPS_PT_outline,
    MPS_PT_photo,
    MPS_PT_real,
    MPS_PT_near,
    MPS_PT_mask,
    MPS_PT_estimate,
    MPS_PT_bake,
    MPS_PT_views,
    MPS_PT_samples,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
