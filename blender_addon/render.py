"""The photo: rendered from the scene under the rig alone, or opened from a file; and the true normals of its view."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.errors import InputError
from mpsnet_core.files import written_whole

from .operators import SaysWhy
from .outputs import load_image, output_path
from .properties import PhotoSettings, take_given
from .rig import light_rig, rig_parts, view_layer

_NORMAL_SAMPLES = 16


class MPS_OT_render_photo(SaysWhy, PhotoSettings, bpy.types.Operator):
    """Render the object with Cycles, lit by the rig's red, green and blue light alone.

    Other lights and the world are off; glowing materials are not. The scene's own render settings stay as they are"""

    bl_idname = "mps.render_photo"
    bl_label = "Render Photo"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return needs_rig(cls, context)

    def act(self, context: Any) -> None:
        scene = context.scene
        take_given(self, PhotoSettings, scene.mps.photo)
        path = output_path(self.output, f"{scene.name}_photo", "EXR")
        render_photo(scene, path)
        scene.mps.photo.image = load_image(path, "MPS Photo", is_data=False)


class MPS_OT_open_photo(SaysWhy, bpy.types.Operator):
    """Open a captured photo: PNG, TIFF, JPEG or OpenEXR"""

    bl_idname = "mps.open_photo"
    bl_label = "Open Photo"
    bl_options = {"UNDO"}

    filepath: StringProperty(
        name="File", description="Photo under red, green and blue light", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context: Any) -> None:
        if not self.filepath:
            raise InputError("no photo was named; give its path as filepath")
        path = Path(bpy.path.abspath(self.filepath))
        context.scene.mps.photo.image = load_image(path, path.stem, is_data=False)


class MPS_OT_render_truth(SaysWhy, bpy.types.Operator):
    """Render the true normals of the photo's view, as an OpenEXR with Blender's Normal pass, to compare with"""

    bl_idname = "mps.render_truth"
    bl_label = "Render True Normals"
    bl_options = {"UNDO"}

    output: StringProperty(
        name="File",
        description="OpenEXR file to write. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        return needs_rig(cls, context)

    def act(self, context: Any) -> None:
        path = output_path(self.output, f"{context.scene.name}_true_normals", "EXR")
        render_normals(context.scene, path)
        self.report({"INFO"}, f"True normals written to {path}")


def needs_rig(cls: Any, context: Any) -> bool:
    """Poll of what needs a rig; its absence is said on the greyed-out button."""
    if not context.scene.mps.rig.lights:
        cls.poll_message_set("Add a rig first")
        return False
    return True


def render_photo(scene: Any, path: Path) -> None:
    """Render what the rig's camera sees under the rig's lights alone, as a linear float EXR with alpha.

    Size and samples are those of ``scene.mps.photo``. Nothing else in the file changes.

    Raises InputError where the rig is incomplete or the file cannot be written.
    """
    light_rig(scene)  # a rig from which no normal could be told is refused before the render, not after
    with _studio(scene) as studio:
        studio.cycles.samples = scene.mps.photo.samples
        studio.cycles.use_denoising = scene.mps.photo.denoise
        studio.cycles.denoising_input_passes = "RGB"
        _render(studio, path, "OPEN_EXR")


def render_normals(scene: Any, path: Path) -> None:
    """Render the true normals of the photo's view as a float multi-layer EXR, H x W as the photo.

    Channels ``ViewLayer.Normal.X``, ``.Y``, ``.Z`` hold the normal in WORLD space (rotate by the transpose of
    ``Camera.rotation`` to come to camera space), averaged over each pixel and so a little shorter than 1 at edges;
    ``ViewLayer.Combined.A`` holds the alpha. Blender 4.5 writes one part with these names, 5.x a part for each pass.

    Raises InputError where the rig is incomplete or the file cannot be written.
    """
    rig_parts(scene)
    with _studio(scene) as studio:
        studio.cycles.samples = _NORMAL_SAMPLES
        studio.cycles.max_bounces = 0
        studio.view_layers[0].use_pass_normal = True
        _render(studio, path, "OPEN_EXR_MULTILAYER")


@contextmanager
def _studio(scene: Any) -> Iterator[Any]:
    """A scene that lives as long as the context: the objects of `scene` under its rig's lights and nothing else."""
    camera, _, lights = rig_parts(scene)
    photo = scene.mps.photo
    studio = bpy.data.scenes.new("MPS Studio")
    try:
        for obj in {*_rendered(view_layer(scene).layer_collection), *lights, camera}:
            studio.collection.objects.link(obj)
        studio.camera = camera
        studio.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        studio.view_layers[0].name = "ViewLayer"
        render = studio.render
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = photo.width, photo.height, 100
        render.film_transparent = True
        render.use_compositing = render.use_sequencer = False
        render.use_simplify = False
        cycles = studio.cycles
        cycles.device = scene.cycles.device
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.sample_clamp_indirect = 0.0
        # Each sample draws one of the three lights. Drawn evenly, and not by the light tree, the noise is a third less.
        cycles.use_light_tree = False
        cycles.sampling_pattern = "BLUE_NOISE"
        yield studio
    finally:
        bpy.data.scenes.remove(studio)


def _rendered(layer: Any) -> Iterator[Any]:
    """Objects of a view layer that its render shows, lights apart."""
    if layer.exclude or layer.collection.hide_render:
        return
    yield from (obj for obj in layer.collection.objects if obj.type != "LIGHT" and not obj.hide_render)
    for child in layer.children:
        yield from _rendered(child)


def _render(studio: Any, path: Path, file_format: str) -> None:
    settings = studio.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "MULTI_LAYER_IMAGE" if file_format == "OPEN_EXR_MULTILAYER" else "IMAGE"
    settings.file_format = file_format
    settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIP"
    studio.render.use_file_extension = False
    if path.suffix.lower() != ".exr":
        raise InputError(f"cannot write {path}: renders are written as OpenEXR; give a name that ends in .exr")
    with written_whole(path) as unfinished:
        studio.render.filepath = str(unfinished)
        try:
            bpy.ops.render.render(write_still=True, scene=studio.name)
        except RuntimeError as error:
            reason = " ".join(str(error).split()).removeprefix("Error: ")
            raise InputError(f"Blender could not render {path}: {reason}") from None
        if not unfinished.is_file():
            raise InputError(f"Blender did not write {path}: the render was cancelled or its disk is full; try again")


CLASSES = (MPS_OT_render_photo, MPS_OT_open_photo, MPS_OT_render_truth)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
