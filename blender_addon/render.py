"""The photo: rendered from the scene under the rig alone, or opened from a file; and the true normals of its view."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.camera import write_camera
from mpsnet_core.errors import InputError
from mpsnet_core.files import PHOTO_SUFFIXES, RAW_SUFFIXES, VIDEO_SUFFIXES, written_whole
from mpsnet_core.rig import write_rig

from .core_process import run
from .made_from import Ingredients, chosen, rounded
from .operators import SaysWhy, told_by
from .outputs import (
    beside,
    frame_pattern,
    literally,
    load_photo,
    output_frames,
    output_path,
    read_beside,
    remember,
    render_path,
)
from .rig import drawn_rig, light_rig, rig_camera, rig_parts, scene_camera, view_layer
from .rigs import result_name
from .settings.declared import take_given
from .settings.photo import PhotoSettings

_NORMAL_SAMPLES = 16


class MPS_OT_render_photo(SaysWhy, PhotoSettings, bpy.types.Operator):
    """Render the object with Cycles, lit by the rig's red, green and blue light alone. The window waits for it.

    Other lights and the world are off. The scene's own render settings stay as they are. The rig and the camera, as
    they stand, are written beside the photo"""

    bl_idname = "mps.render_photo"
    bl_label = "Render Photo"
    bl_options = {"UNDO"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.rig.lights else "Add a rig first"

    @classmethod
    def made_from(cls, context: Any) -> Ingredients:
        return {**_drawn(context.scene), **chosen(PhotoSettings, context.scene.mps.photo)}

    def act(self, context: Any) -> None:
        scene = context.scene
        take_given(self, PhotoSettings, scene.mps.photo)
        if self.animation:
            folder = output_frames(self.output, result_name(scene, "photo"))
            path = render_frames(scene, folder)
        else:
            path = output_path(self.output, result_name(scene, "photo"), "EXR")
            render_photo(scene, path)
        self._made_from = self.made_from(context)
        scene.mps.photo.image = image = load_photo(path, "MPS Photo Frames" if self.animation else "MPS Photo")
        if self.animation:
            image.source = "SEQUENCE"
        self.made(image)


class MPS_OT_open_photo(SaysWhy, bpy.types.Operator):
    """Open a captured photo (PNG, TIFF, JPEG, OpenEXR, camera raw), all frames of a sequence, or a video.

    Files NAME.rig.json and NAME.camera.json beside it are read"""

    bl_idname = "mps.open_photo"
    bl_label = "Open Photo"
    bl_options = {"UNDO"}

    filepath: StringProperty(
        name="File", description="Photo under red, green and blue light", subtype="FILE_PATH", options={"SKIP_SAVE"}
    )
    sequence: bpy.props.BoolProperty(
        name="All Frames",
        description="The photo is a numbered frame, and all frames that are numbered like it are meant",
        default=False,
        options={"SKIP_SAVE"},
    )
    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in (*PHOTO_SUFFIXES, *VIDEO_SUFFIXES)), options={"HIDDEN", "SKIP_SAVE"}
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context: Any) -> None:
        if not self.filepath:
            raise InputError("no photo was named; give its path as filepath")
        path = Path(bpy.path.abspath(self.filepath))
        image = load_raw(path) if path.suffix.lower() in RAW_SUFFIXES else load_photo(path, path.stem)
        if self.sequence:
            frame_pattern(path)  # says so where it has no number
            image.source = "SEQUENCE"
        self._made_from = self.made_from(context)
        self.made(image)
        context.scene.mps.photo.image = image


def _drawn(scene: Any) -> Ingredients:
    """Lights and camera as Blender last evaluated them; nothing where no photo can be taken with them."""
    try:
        rig = drawn_rig(scene)
    except InputError:
        return {}
    lights = rounded(rig.directions, 3) + rounded(rig.mixing, 3)
    return {"Lights": lights, "Camera": rounded(rig_camera(scene).matrix_world, 4)}


def load_raw(path: Path) -> bpy.types.Image:
    """A camera raw file as an image to look at; what reads the photo goes on reading the raw file."""
    shown = Path(bpy.app.tempdir) / f"{path.stem}.exr"
    run(["superpose", str(path), "--output", str(shown)], [shown])
    image = load_photo(shown, path.stem)
    remember(image, "source", str(path))
    for what in ("rig", "camera"):
        remember(image, what, read_beside(path, what))
    return image


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
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.rig.lights else "Add a rig first"

    def act(self, context: Any) -> None:
        path = output_path(self.output, result_name(context.scene, "true_normals"), "EXR")
        render_normals(context.scene, path)
        self.report({"INFO"}, f"True normals written to {path}")


def render_photo(scene: Any, path: Path) -> None:
    """Render what the rig's camera sees under the rig's lights alone, as a linear float EXR with alpha.

    Size and samples are those of ``scene.mps.photo``. The rig and the camera are written beside the photo, see
    :func:`.outputs.beside`. Nothing in the .blend file changes.

    Raises InputError where the rig is incomplete, something else shines or the file cannot be written.
    """
    render_path(path)
    rig, photo = light_rig(scene), scene.mps.photo
    camera, _, lights = rig_parts(scene)
    with _studio(scene) as studio, TemporaryDirectory(prefix="mpsnet-") as folder, _progress(len(lights)) as done:
        _refuse_other_light(studio)
        studio.cycles.samples = photo.samples
        # Each Cycles sample draws one of the lights by chance; with one light at a time there is no such noise.
        parts = [Path(folder) / f"{number}.exr" for number in range(len(lights))]
        for number, (light, part) in enumerate(zip(lights, parts, strict=True)):
            done(number)
            others = [other for other in lights if other != light]
            for other in others:
                studio.collection.objects.unlink(other)
            _render(studio, part, "OPEN_EXR")
            for other in others:
                studio.collection.objects.link(other)
        run(["superpose", *map(str, parts), "--output", str(path)], [path])
    write_rig(beside(path, "rig"), rig)
    write_camera(beside(path, "camera"), scene_camera(camera, scene, (photo.width, photo.height)))


def render_frames(scene: Any, folder: Path) -> Path:
    """:func:`render_photo` of each frame of the scene into `folder`, called by their numbers; gives the first's file.

    Raises InputError as that does.
    """
    current, digits = scene.frame_current, max(4, len(str(scene.frame_end)))
    files = []
    try:
        for number in range(scene.frame_start, scene.frame_end + 1):
            scene.frame_set(number)
            files.append(folder / f"{folder.name}_{number:0{digits}d}.exr")
            render_photo(scene, files[-1])
    finally:
        scene.frame_set(current)
    return files[0]


def render_normals(scene: Any, path: Path) -> None:
    """Render the true normals of the photo's view as a float multi-layer EXR, H x W as the photo.

    Channels ``ViewLayer.Normal.X``, ``.Y``, ``.Z`` hold the normal in WORLD space (rotate by the transpose of
    ``Camera.rotation`` to come to camera space), averaged over each pixel and so a little shorter than 1 at edges;
    ``ViewLayer.Combined.A`` holds the alpha. Blender 4.5 writes one part with these names, 5.x a part for each pass.

    Raises InputError where the rig is incomplete or the file cannot be written.
    """
    render_path(path)
    with _studio(scene) as studio:
        studio.cycles.samples = _NORMAL_SAMPLES
        studio.cycles.max_bounces = 0
        studio.view_layers[0].use_pass_normal = True
        _render(studio, path, "OPEN_EXR_MULTILAYER")


@contextmanager
def _progress(steps: int) -> Iterator[Callable[[int], None]]:
    """Blender's progress at the mouse pointer; called with the number of steps that are done."""
    manager = bpy.context.window_manager
    manager.progress_begin(0, steps)
    try:
        yield manager.progress_update
    finally:
        manager.progress_end()


@contextmanager
def _studio(scene: Any) -> Iterator[Any]:
    """A scene that lives as long as the context: the objects of `scene` under its rig's lights and nothing else.

    It has no simulation of rigid bodies: apply or bake to keyframes what shall stand where physics brought it.
    """
    camera, _, lights = rig_parts(scene)
    photo = scene.mps.photo
    studio = bpy.data.scenes.new("MPS Studio")
    try:
        # In order and each once: the order decides how Cycles numbers things, and so its noise.
        for obj in dict.fromkeys([*_rendered(view_layer(scene).layer_collection), *lights, camera]):
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
        yield studio
    finally:
        bpy.data.scenes.remove(studio)


def _rendered(layer: Any, special: str = "") -> Iterator[Any]:
    """Objects of a view layer that its render shows, lights apart.

    special: the collection above that the view layer shows as holdout or only indirectly, which a photo cannot.
    """
    if layer.collection.hide_render:
        return
    if layer.holdout or layer.indirect_only:
        special = layer.collection.name
    # A collection within an excluded one may be included again.
    for obj in () if layer.exclude else layer.collection.objects:
        if obj.type == "LIGHT" or obj.hide_render:
            continue
        if special:
            raise InputError(
                f'"{obj.name}" is in the collection "{special}", which this view layer shows as holdout or indirect '
                "only; switch that off or exclude the collection"
            )
        yield obj
    for child in layer.children:
        yield from _rendered(child, special)


def _refuse_other_light(studio: Any) -> None:
    """A photo under the three lights alone cannot have a fourth in it, not even one that an instance brings."""
    for obj in studio.objects:  # also those that the viewport, and so the dependency graph, hides
        refuse_glow(obj, obj.name)
    for instance in studio.view_layers[0].depsgraph.object_instances:
        owner = (instance.parent or instance.object).name
        if instance.object.original.hide_render:
            continue
        if instance.is_instance and instance.object.type == "LIGHT":
            raise InputError(
                f'"{owner}" holds the light "{instance.object.name}", but the photo shows the three lights alone; '
                "hide it from renders"
            )
        refuse_glow(instance.object, owner)


def refuse_glow(obj: Any, owner: str) -> None:
    """Raises InputError where one of the object's materials glows. owner: the object's name for people."""
    for slot in obj.material_slots:
        if slot.material and slot.material.node_tree and _glows(slot.material.node_tree):
            raise InputError(
                f'material "{slot.material.name}" of "{owner}" glows, but the three lights alone shall shine; '
                "set its emission to 0"
            )


def _glows(tree: Any) -> bool:
    for node in tree.nodes:
        if node.type == "GROUP" and node.node_tree and _glows(node.node_tree):
            return True
        prefix = "" if node.type == "EMISSION" else "Emission "
        strength, colour = node.inputs.get(f"{prefix}Strength"), node.inputs.get(f"{prefix}Color")
        if strength is None or colour is None or not node.outputs[0].is_linked:
            continue
        bright = strength.is_linked or strength.default_value > 0
        if bright and (colour.is_linked or max(colour.default_value[:3]) > 0):
            return True
    return False


def _render(studio: Any, path: Path, file_format: str) -> None:
    settings = studio.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "MULTI_LAYER_IMAGE" if file_format == "OPEN_EXR_MULTILAYER" else "IMAGE"
    settings.file_format = file_format
    settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIP"
    studio.render.use_file_extension = False
    with written_whole(path) as unfinished:
        studio.render.filepath = literally(unfinished)
        try:
            bpy.ops.render.render(write_still=True, scene=studio.name)
        except RuntimeError as error:
            raise InputError(f"Blender could not render {path}: {told_by(error)}") from None
        if not unfinished.is_file():
            raise InputError(f"Blender did not write {path}: the render was cancelled or its disk is full; try again")


CLASSES = (MPS_OT_render_photo, MPS_OT_open_photo, MPS_OT_render_truth)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
