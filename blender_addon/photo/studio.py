"""The studio: renders of the scene from the rig's camera, under the rig's lights alone, and of its true normals."""

import glob
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError, NoObject, Note
from mpsnet_core.io.files import atomic_write, temporary_folder, write_transaction
from mpsnet_core.io.metadata import content_fingerprint
from mpsnet_core.io.provenance import digest
from mpsnet_core.scene.camera import Camera, write_camera
from mpsnet_core.scene.rig import write_rig

from ..appearance.shader_graph import End, nodes_behind, uses_nodes
from ..errors import operator_errors
from ..image_records import sidecar
from ..openimageio import load_openimageio
from ..outputs import render_path, with_escaped_braces
from ..rig.rig import last_evaluated_rig, rig_camera, rig_parts
from ..scene.camera import scene_camera
from ..scene.objects import rendered, view_layer
from ..scene.surfaces import box_of, surfaces

# Called before each Cycles render with the number done, the total, and words for the one that starts.
RenderProgress = Callable[[int, int, str], None]

# Marks an object that shows a flat material.
FLAT_PLANE = "mpsnet_flat_plane"
_NORMAL_SAMPLES = 16
_SUBDIVISION = ("dicing_rate", "offscreen_dicing_scale", "max_subdivisions")
# Tolerance of equal bounding boxes, as a fraction of the diagonal: those of a low-poly and a detailed object differ.
_SAME_PLACE = 0.1


# A photo, a photo of each frame, or the true normals of the photo's view.
RenderKind = Literal["photo", "frames", "normals"]


def white_of(photo: Path) -> Path:
    """The file of the white photo that is rendered with a photo."""
    return photo.with_name(f"{photo.stem}_white{photo.suffix}")


def no_render_progress(done: int, renders: int, words: str) -> None:
    """Ignore the progress of renders."""


class Rendered(NamedTuple):
    """What was rendered."""

    file: Path
    """The file, or the first one of several frames."""
    notes: list[Note]
    """Sentences for the user."""
    files: list[Path]
    """All files that belong to it."""
    kept: bool = False
    """Whether an earlier run had rendered it."""


def render(
    what: RenderKind, scene: Any, output: Path, progress: RenderProgress = no_render_progress, facts: str = ""
) -> Rendered:
    """Render to a file, or frames to a folder. facts: of frames, see :func:`render_photo`. Raises InputError."""
    if what == "frames":
        return render_frames(scene, output, progress, facts)
    return (render_photo if what == "photo" else render_normals)(scene, output, progress)


def render_photo(scene: Any, path: Path, progress: RenderProgress = no_render_progress, facts: str = "") -> Rendered:
    """Render a photo from the rig's camera, under the rig's lights alone, as a linear float EXR with alpha.

    Size and samples are those of ``scene.mps.photo``. Rig and camera are written to sidecar files, see
    :func:`.image_records.sidecar`. Nothing in the .blend file changes. The bake's target is left out if another object
    is at the same place.

    With its setting `white`, the white photo is written beside it.

    facts: what the photo depends on apart from the rig, the camera and the settings, see :func:`scene_facts`. A photo
    that an earlier run made from the same is kept. "" if they are unknown.

    Raises InputError if the rig is incomplete, something else emits light, nothing is visible or the file cannot be
    written.
    """
    render_path(path)
    photo, (camera, _, lights) = scene.mps.photo, rig_parts(scene)
    with _studio(scene) as studio, temporary_folder() as folder:
        depsgraph = studio.view_layers[0].depsgraph
        rig = last_evaluated_rig(scene, depsgraph)
        taken_by = scene_camera(camera.evaluated_get(depsgraph), scene, (photo.width, photo.height))
        notes = [*_leave_target_out(studio, scene.mps.bake), *_out_of_focus(camera.evaluated_get(depsgraph))]
        _refuse_other_light(studio)
        studio.cycles.samples = photo.samples
        white = [white_of(path)] if photo.white and not photo.animation else []
        files = [path, sidecar(path, "rig"), sidecar(path, "camera"), *white]
        place = f"{scene.frame_current_final} {photo.samples} {sorted(obj.name for obj in studio.objects)}"
        line = f"render {digest(facts, place, repr(rig), repr(taken_by))}" if facts else ""
        if _is_there(path, line):
            return Rendered(path, notes, files, kept=True)
        parts = _render_lights_apart(studio, lights, folder, progress, len(white))
        for file in white:
            progress(len(lights), len(lights) + 1, "rendering under white light")
            _render_white(studio, lights, file)
        load_openimageio()
        from mpsnet_core.capture.superpose import superpose
        from mpsnet_core.io.image_writing import write_photo

        with write_transaction():
            write_rig(sidecar(path, "rig"), replace(rig, is_ground_truth=True))
            write_camera(sidecar(path, "camera"), taken_by)
            write_photo(path, superpose(parts), bits=32, description=line or None)
    return Rendered(path, notes, files)


def _render_lights_apart(
    studio: Any, lights: Sequence[Any], folder: Path, progress: RenderProgress, more: int
) -> list[Path]:
    """Render under each light alone. Each Cycles sample picks one of the lights at random; this avoids that noise.

    more: number of renders that follow, for the progress.
    """
    parts = [folder / f"{number}.exr" for number in range(len(lights))]
    for number, (light, part) in enumerate(zip(lights, parts, strict=True)):
        progress(number, len(lights) + more, f"rendering light {number + 1} of {len(lights)}")
        others = [other for other in lights if other != light]
        for other in others:
            studio.collection.objects.unlink(other)
        _render(studio, part, "OPEN_EXR")
        for other in others:
            studio.collection.objects.link(other)
    return parts


def _render_white(studio: Any, lights: Sequence[Any], path: Path) -> None:
    """Render under copies of the lights that are white."""
    copies = [light.copy() for light in lights]
    try:
        for light, copy in zip(lights, copies, strict=True):
            copy.data = light.data.copy()
            copy.data.color = (1, 1, 1)
            studio.collection.objects.unlink(light)
            studio.collection.objects.link(copy)
        _render(studio, path, "OPEN_EXR")
    finally:
        bpy.data.batch_remove([*(copy.data for copy in copies), *copies])


def _is_there(path: Path, line: str) -> bool:
    """Whether an earlier run has written this photo, with its rig and its camera."""
    if not (line and all(sidecar(path, what).is_file() for what in ("rig", "camera")) and path.is_file()):
        return False
    load_openimageio()
    from mpsnet_core.io.provenance import is_up_to_date

    return is_up_to_date(path, line)


def scene_facts(output: Path) -> str:
    """What renders of the open .blend file into the folder `output` depend on outside of it; "" if it is not saved.

    That is its contents, and name, size and time of each file that it uses.
    """
    if not bpy.data.filepath:
        return ""
    used = {Path(path) for path in bpy.utils.blend_paths(absolute=True)}
    there = sorted(path for path in used if path.is_file() and output not in path.parents)
    stats = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in there]
    return f"{bpy.app.version_string} {content_fingerprint(bpy.data.filepath)} {stats}"


def render_frames(scene: Any, folder: Path, progress: RenderProgress = no_render_progress, facts: str = "") -> Rendered:
    """:func:`render_photo` for each frame of the scene into `folder`, named by frame number. Returns the first file.

    Raises InputError as that function does.
    """
    current, subframe = scene.frame_current, scene.frame_subframe
    digits = max(4, len(str(scene.frame_end)))
    numbers = range(scene.frame_start, scene.frame_end + 1)
    files = [folder / f"{folder.name}_{number:0{digits}d}.exr" for number in numbers]
    rendered: list[Rendered] = []
    empty: dict[int, str] = {}
    try:
        for place, (number, file) in enumerate(zip(numbers, files, strict=True)):
            scene.frame_set(number)

            def of_all(done: int, renders: int, words: str, number: int = number, place: int = place) -> None:
                progress(place * renders + done, len(files) * renders, f"frame {number}: {words}")

            try:
                rendered.append(render_photo(scene, file, of_all, facts))
            except NoObject as error:
                empty[number] = str(error)
            except InputError as error:
                raise InputError(f"frame {number}: {error}") from None
    finally:
        scene.frame_set(current, subframe=subframe)
    if not rendered:
        raise InputError(f"no frame shows the object; {empty[numbers[0]]}")
    notes = rendered[0].notes
    if kept := sum(one.kept for one in rendered):
        notes.append(Note("%d frame(s) were there already and are kept", kept))
    if empty:
        words = "%d frame(s) show nothing and are left out, the first is %d"
        notes.append(Note(words, len(empty), min(empty), level="look"))
    others = {file for file in folder.glob(f"{glob.escape(folder.name)}_*.exr") if file not in files}
    if others:
        words = "%d frame(s) of an earlier render are in the folder too, and are estimated with these"
        notes.append(Note(words, len(others), level="look"))
    return Rendered(rendered[0].file, notes, [file for one in rendered for file in one.files])


def render_normals(scene: Any, path: Path, progress: RenderProgress = no_render_progress) -> Rendered:
    """Render the true normals of the photo's view as a float multi-layer EXR, H x W as the photo.

    Channels ``ViewLayer.Normal.X``, ``.Y``, ``.Z`` hold the normal in WORLD space (the transpose of
    ``Camera.rotation`` rotates it to camera space), averaged over each pixel and so a little shorter than 1 at edges;
    ``ViewLayer.Combined.A`` holds the alpha. Blender 4.5 writes one part with these names, 5.x a part for each pass.

    The camera is written to a sidecar file. Raises InputError if the rig is incomplete or the file cannot be written.
    """
    render_path(path)
    camera, photo = rig_camera(scene), scene.mps.photo
    with _studio(scene) as studio, write_transaction():
        notes = _leave_target_out(studio, scene.mps.bake)
        studio.cycles.samples = _NORMAL_SAMPLES
        studio.cycles.max_bounces = 0
        studio.view_layers[0].use_pass_normal = True
        progress(0, 1, "rendering the true normals")
        seen_by = camera.evaluated_get(studio.view_layers[0].depsgraph)
        write_camera(sidecar(path, "camera"), scene_camera(seen_by, scene, (photo.width, photo.height)))
        _render(studio, path, "OPEN_EXR_MULTILAYER")
    return Rendered(path, notes, [path, sidecar(path, "camera")])


@contextmanager
def _studio(scene: Any) -> Iterator[Any]:
    """A temporary scene with the objects of `scene` under its rig's lights and nothing else.

    It has no rigid body simulation: apply or bake to keyframes the objects that physics has moved.
    """
    camera, _, lights = rig_parts(scene)
    photo = scene.mps.photo
    studio = bpy.data.scenes.new("MPS Studio")
    try:
        # In order and each once: the order determines Cycles' numbering, and so its noise.
        shown = [*rendered(view_layer(scene).layer_collection)]
        shown = [obj for obj in shown if FLAT_PLANE not in obj] or shown  # what shows a flat material is no subject
        for obj in dict.fromkeys([*shown, *lights, camera]):
            studio.collection.objects.link(obj)
        studio.camera = camera
        _take_time_and_subdivision(studio, scene)
        studio.frame_set(scene.frame_current, subframe=scene.frame_subframe)
        # Check the camera at this frame: animation may change its type, too, and a custom camera would run a shader.
        scene_camera(camera.evaluated_get(studio.view_layers[0].depsgraph), scene)
        studio.view_layers[0].name = "ViewLayer"
        render = studio.render
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = photo.width, photo.height, 100
        render.film_transparent = True
        render.use_compositing = render.use_sequencer = False
        render.use_simplify = False
        cycles = studio.cycles
        cycles.device = scene.cycles.device or "CPU"  # "" if the file has an unknown one
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        cycles.sample_clamp_indirect = 0.0
        yield studio
    finally:
        bpy.data.scenes.remove(studio)


def _take_time_and_subdivision(studio: Any, scene: Any) -> None:
    """Copy to the studio what animation, modifiers and drivers read from the scene: frame times, adaptive subdivision,
    custom properties."""
    for settings, ours, names in (
        (scene.render, studio.render, ("fps", "fps_base", "frame_map_old", "frame_map_new")),
        (scene.cycles, studio.cycles, ("feature_set", *_SUBDIVISION)),
    ):
        for name in names:
            if hasattr(settings, name):
                setattr(ours, name, getattr(settings, name))
    for name in set(scene.keys()) - set(scene.bl_rna.properties.keys()):
        studio[name] = scene[name]


def _leave_target_out(studio: Any, bake: Any) -> list[Note]:
    """Remove the bake target from the studio if another object, or several together, are at the same place.

    Returns a sentence on that, or if two objects are at the same place and neither is known to be the target.
    """
    if bake.objects != "ACTIVE":
        return []
    clouds: dict[Any, list[NDArray[np.float64]]] = {}
    for owner, points in surfaces(studio.view_layers[0].depsgraph, studio.objects):
        clouds.setdefault(owner, []).append(np.stack([points.min(axis=0), points.max(axis=0)]))
    # (2, 3) each: the lowest and the highest coordinates.
    boxes = {obj: np.stack([np.min(ends, axis=0)[0], np.max(ends, axis=0)[1]]) for obj, ends in clouds.items()}
    if bake.target is None:
        return _note_coinciding({obj: box for obj, box in boxes.items() if obj.type == "MESH"})
    place = boxes.pop(bake.target, None)
    within = [] if place is None else _in_place(place, boxes)
    if not within:
        return []
    studio.collection.objects.unlink(bake.target)
    studio.view_layers[0].update()
    names = sorted(obj.name for obj in within)
    one = '"%s" is left out of the photo: it is the target of the bake, and "%s" is in its place'
    more = '"%s" is left out of the photo: it is the target of the bake, and "%s" and %d more are in its place'
    several = (len(names) - 1,) if len(names) > 1 else ()
    return [Note(more if several else one, bake.target.name, names[0], *several)]


def objects_in_photo(scene: Any) -> list[Any]:
    """The mesh objects whose middle a photo shows as the scene is now, and hidden ones in their place."""
    view_layer(scene).update()
    frame = scene_camera(rig_camera(scene), scene, (scene.mps.photo.width, scene.mps.photo.height))
    shown = set(rendered(view_layer(scene).layer_collection))
    boxes = {obj: box_of(obj) for obj in scene.objects if obj.type == "MESH"}
    visible = {obj: box for obj, box in boxes.items() if obj in shown and _is_inside(frame, box.mean(axis=0))}
    return [obj for obj, box in boxes.items() if obj in visible or (obj not in shown and _in_place(box, visible))]


def _is_inside(frame: Camera, point: NDArray[np.float64]) -> bool:
    x, y, w = frame.projection_rows() @ [*point, 1]
    return bool(w > 0 and 0 < x < w * frame.width and 0 < y < w * frame.height)


def _in_place(place: NDArray[np.float64], boxes: Mapping[Any, NDArray[np.float64]]) -> list[Any]:
    """The objects that together are at a place, a box (2, 3)."""
    reach = _SAME_PLACE * np.linalg.norm(place[1] - place[0])
    within = {
        obj: box
        for obj, box in boxes.items()
        if (box[0] > place[0] - reach).all() and (box[1] < place[1] + reach).all()
    }
    if not within:
        return []
    ends = np.stack(list(within.values()))
    return list(within) if _coincide(place, np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])) else []


def _note_coinciding(boxes: Mapping[Any, NDArray[np.float64]]) -> list[Note]:
    """A sentence if two objects are at the same place; otherwise nothing."""
    for one, other in combinations(boxes, 2):
        if _coincide(boxes[one], boxes[other]):
            words = (
                '"%s" and "%s" are in one place and both in the photo; choose the one that is baked onto as Target of '
                "the step Bake, and it is left out"
            )
            return [Note(words, one.name, other.name, level="look")]
    return []


def _coincide(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether two boxes (2, 3) nearly coincide."""
    reach = _SAME_PLACE * np.linalg.norm(one[1] - one[0])
    # In scenes with many objects, a single coordinate distinguishes most pairs.
    return bool(abs(one[0, 0] - other[0, 0]) < reach and np.abs(one - other).max() < reach)


def _out_of_focus(camera: Any) -> list[Note]:
    """A sentence if the camera has depth of field; otherwise nothing."""
    if not camera.data.dof.use_dof:
        return []
    words = '"%s" has depth of field on: where the photo is blurred, so are its normals; switch it off'
    return [Note(words, camera.name, level="look")]


def _refuse_other_light(studio: Any) -> None:
    """Raise InputError if anything else in the studio emits light, even an instance."""
    for obj in studio.objects:  # also those hidden in the viewport, and so missing in the dependency graph
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
    """Raise InputError if one of the object's materials emits light. owner: the object's name in the message."""
    for slot in obj.material_slots:
        if slot.material and _glows(slot.material):
            raise InputError(
                f'material "{slot.material.name}" of "{owner}" glows, but only the three lights may light the photo; '
                "set its emission to 0"
            )


def _glows(material: Any) -> bool:
    output = material.node_tree.get_output_node("CYCLES") if uses_nodes(material) else None
    ends = [End(output.inputs[name]) for name in ("Surface", "Volume")] if output is not None else []
    return any(_emits(node) for end in ends for node in nodes_behind(end) if not node.mute)


def _emits(node: Any) -> bool:
    prefix = "" if node.type == "EMISSION" else "Emission "
    strength, colour = node.inputs.get(f"{prefix}Strength"), node.inputs.get(f"{prefix}Color")
    if strength is None or colour is None:
        return False
    bright = strength.is_linked or strength.default_value > 0
    return bool(bright and (colour.is_linked or max(colour.default_value[:3]) > 0))


def _render(studio: Any, path: Path, file_format: str) -> None:
    settings = studio.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "MULTI_LAYER_IMAGE" if file_format == "OPEN_EXR_MULTILAYER" else "IMAGE"
    settings.file_format = file_format
    settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIP"
    studio.render.use_file_extension = False
    with atomic_write(path) as unfinished:
        studio.render.filepath = with_escaped_braces(unfinished)
        with operator_errors(f"Blender could not render {path}", "see what it printed"):
            bpy.ops.render.render(write_still=True, scene=studio.name)
        load_openimageio()  # not needed at Blender's start
        from mpsnet_core.io.image_writing import is_complete_image

        if not is_complete_image(unfinished):
            raise InputError(f"Blender did not write {path}: the render was cancelled or its disk is full; try again")
