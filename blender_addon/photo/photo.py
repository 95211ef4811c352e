"""The photo: rendered under the rig alone, opened from a file, or combined from three; and its true normals.

Before it is used, its exposure, lights and focus are checked.
"""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.capture.operations import Check, Superpose
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import HEIF_SUFFIXES, IMAGE_SUFFIXES, PHOTO_SUFFIXES, RAW_SUFFIXES, VIDEO_SUFFIXES

from ..child_process.core_process import Program, Work, run
from ..child_process.linked_data import not_found
from ..child_process.trust import blocked_scripts_note
from ..image_records import Provenance, chosen, file_stamp, origin, remember, rounded
from ..images import frame_pattern, image_file, load_photo
from ..openimageio import load_openimageio
from ..operators.choose_file import remember_folder, start_folder
from ..operators.core_run import RunsCore
from ..operators.progress import cursor_progress
from ..operators.reporting import ReportingOperator
from ..outputs import output_frames, output_path, render_path
from ..rig.rig import light_rig, lights_provenance, rig_camera
from ..rig.several_rigs import OnEachRig, result_name
from ..scene.objects import find_object
from ..settings.declared import BoolSetting, FileSetting, StringSetting, options_of
from ..settings.photo import PhotoSettings, SuperposeSettings
from .background_render import rendering_blender, written_job
from .camera import PLACES, places_of
from .options import reading, rig_file_for, rig_path
from .studio import RenderKind, objects_in_photo, render, scene_facts, white_of

LIGHTS = ("first", "second", "third")
_VERDICTS = {"good": "The photo is good", "watch": "The photo can be used", "bad": "The photo should be taken again"}


class _Renders(RunsCore):
    """An operator that renders: from a button in another Blender process, from a script in this one."""

    target: StringSetting(
        "Target",
        "Name of the mesh object that is baked onto later. It is left out of the picture where the "
        "detailed object is in its place. Empty: the target of the step Bake",
    )
    resume: BoolSetting(
        "Resume",
        "Of an animation, keep the frames that an interrupted run rendered from the same saved file, "
        "settings and rig. Only if this script changes nothing else in the scene",
    )
    _first_job: dict[str, Any] | None = None  # its copy of the file serves all rigs

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.rig.lights else "Add a rig first"

    def destination(self, scene: Any) -> tuple[RenderKind, Path]:
        """What the operator's settings render, and the file or folder."""
        raise NotImplementedError

    def _destination(self, scene: Any) -> tuple[RenderKind, Path]:
        if self.target:
            target = find_object(scene, self.target)
            if target.type != "MESH":
                raise InputError(f'the target "{target.name}" is no mesh object; name one')
            scene.mps.bake.target = target
        return self.destination(scene)

    def prepare(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        what, output = self._destination(context.scene)
        light_rig(context.scene)  # report errors of the rig at once
        self._notes = not_found(context.scene)
        self._first_job = self._first_job or written_job(context, what, output, folder)
        work = {**self._first_job, "what": what, "output": str(output), "rig": context.scene.mps.chosen_rig}
        return work, [output / "frames" if what == "frames" else output]

    def program(self, folder: Path) -> Program:
        return rendering_blender(folder)

    def run_here(self, context: Any) -> None:
        self.take_settings(context)
        what, output = self._destination(context.scene)
        self.check_outputs([output])
        self._notes = not_found(context.scene)
        with cursor_progress(context.window_manager) as progress:
            facts = scene_facts(output) if self.resume and what == "frames" else ""
            rendered = render(what, context.scene, output, lambda done, of, words: progress(done / of, words), facts)
        self._notes += [*blocked_scripts_note(), *rendered.notes]
        self._made_from = self.provenance(context)
        self._finished(context, {"output": str(rendered.file), "written": [*map(str, rendered.files)]})


class MPS_OT_render_photo(OnEachRig, _Renders, PhotoSettings, bpy.types.Operator):
    """Render the object with Cycles, lit by the rig's red, green and blue light alone, beside the live window.

    Other lights and the world are off. The scene is rendered as it is now and stays as it is. The rig and the camera,
    as they stand, are written beside the photo"""

    bl_label = "Render Photo"
    step = "photo"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        # As at Blender's last evaluation; empty if they cannot take a photo.
        lights, scene = lights_provenance(context.scene), context.scene
        camera = {"Camera": rounded(rig_camera(scene).matrix_world, 4)} if lights else {}
        return {**lights, **camera, **chosen(scene.mps.photo)}

    def destination(self, scene: Any) -> tuple[RenderKind, Path]:
        self._moves = self.animation
        self._places = None if self._moves else places_of(objects_in_photo(scene))
        if self._moves:
            return "frames", output_frames(self.output, result_name(scene, "photo"))
        return "photo", render_path(output_path(self.output, result_name(scene, "photo"), "EXR"))

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        rig = self.rig(f"its photo is in {result['output']}")
        image = load_photo(Path(result["output"]), "MPS Photo Frames" if self._moves else "MPS Photo")
        remember(image, PLACES, self._places)
        _set_photo(rig, image)
        white = str(white_of(Path(result["output"])))
        if self.white and not self._moves:
            rig.estimate.white, rig.estimate.albedo = white, True
        elif rig.estimate.white == white:
            rig.estimate.property_unset("white")
        if self._moves:
            image.source = "SEQUENCE"
        self.made(image)
        self.tell(f"Photo written to {result['output']}")


class MPS_OT_open_photo(ReportingOperator, bpy.types.Operator):
    """Open a captured photo (PNG, TIFF, JPEG, OpenEXR, camera raw), all frames of a sequence, or a video.

    Files NAME.rig.json and NAME.camera.json beside it are read"""

    bl_label = "Open Photo"

    filepath: FileSetting("File", "Photo under red, green and blue light")
    sequence: BoolSetting(
        "All Frames", "The photo is a numbered frame, and all frames that are numbered like it are meant"
    )
    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in (*PHOTO_SUFFIXES, *VIDEO_SUFFIXES)), options={"HIDDEN", "SKIP_SAVE"}
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if self.filepath:  # by drag and drop
            return self.execute(context)
        photo = context.scene.mps.photo.image
        self.filepath = start_folder(context, str(origin(photo)) if photo else "")  # the next one is probably beside it
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context: Any) -> None:
        if not self.filepath:
            raise InputError("no photo was named; give its path as filepath")
        path = Path(bpy.path.abspath(self.filepath))
        remember_folder(self.filepath)
        image = load_any_photo(path)
        if self.sequence and path.suffix.lower() not in VIDEO_SUFFIXES:
            frame_pattern(path)  # raises without a frame number
            image.source = "SEQUENCE"
        self._made_from = self.provenance(context)
        self.made(image)
        _set_photo(context.scene.mps, image)
        context.scene.mps.way = "PHOTOGRAPH"


class MPS_FH_photo(bpy.types.FileHandler):
    """Drag and drop: a photo dropped into a 3D viewport or an image editor becomes the photo."""

    bl_label = "Open as Photo of MPS-Net"
    bl_import_operator = "mps.open_photo"
    bl_file_extensions = ";".join((*PHOTO_SUFFIXES, *VIDEO_SUFFIXES))

    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        return context.area is not None and context.area.type in {"VIEW_3D", "IMAGE_EDITOR"}


class MPS_OT_superpose(RunsCore, SuperposeSettings, bpy.types.Operator):
    """Make one photo of three, each of them under one white light alone.

    Neither object nor camera may move between them. Each photo becomes a channel, so that paint does not mislead the
    estimate, and all together are the white photo, which shows the colours"""

    bl_label = "Make One Photo"
    step = "superpose"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        settings = context.scene.mps.superpose
        files = {settings.bl_rna.properties[name].name: file_stamp(getattr(settings, name)) for name in LIGHTS}
        return {**files, **chosen(settings, only=("encoding",))}

    def prepare(self, context: Any, folder: Path) -> tuple[Superpose, Sequence[Path]]:
        scene = context.scene
        photos = [getattr(self, name) for name in LIGHTS]
        for name, photo in zip(LIGHTS, photos, strict=True):
            if not photo:
                raise InputError(f"no photo under the {name} light is named; choose one for each of the three lights")
        output = render_path(output_path(self.output, result_name(scene, "superposed"), "EXR"))
        images, white = tuple(map(bpy.path.abspath, photos)), output.with_name(f"{output.stem}_white.exr")
        options = {**options_of(Superpose, self), "white": str(white)}
        return Superpose(image=images, channels=True, output=str(output), **options), [output, white]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        photo = Path(result["output"])
        rig = self.rig(f"its photo is in {photo}")
        image = load_photo(photo, photo.stem)
        self.made(image)
        _set_photo(rig, image)
        rig.estimate.encoding = "AUTO"  # the setting was for the three photos; this file states its own
        rig.estimate.white = str(photo.with_name(f"{photo.stem}_white.exr"))
        self.tell(f"Photo written to {photo}")


def _set_photo(rig: Any, image: bpy.types.Image) -> None:
    """Make an image the photo of a rig."""
    rig.photo.settings_of = rig.photo.settings_of or rig.photo.image  # as in files of earlier versions
    rig.photo.image = image


def _is_shown_as_read(path: Path) -> bool:
    """Whether Blender shows a photo as the core reads it: no camera raw, HEIC or AVIF, and no EXIF orientation."""
    load_openimageio()  # not needed at Blender's start
    from mpsnet_core.io.image_reading import read_orientation

    suffix = path.suffix.lower()
    if suffix in (*RAW_SUFFIXES, *HEIF_SUFFIXES):
        return False
    return suffix not in IMAGE_SUFFIXES or read_orientation(path) == 1


def load_any_photo(path: Path) -> bpy.types.Image:
    """An image that shows a photo as the core reads it. Operations still read the photo's own file."""
    if _is_shown_as_read(path):
        return load_photo(path, path.stem)
    # Cameras number files in the same way: photos in different folders may have the same name.
    number = hashlib.sha256(os.fsencode(path.absolute())).hexdigest()[:8]
    shown = Path(bpy.app.tempdir) / f"{path.stem}_{number}.exr"
    run(Superpose(image=(str(path),), encoding="auto", channels=False, output=str(shown)), [shown])
    return load_photo(shown, path.stem, path)


class MPS_OT_render_truth(_Renders, bpy.types.Operator):
    """Render the true normals of the photo's view, as an OpenEXR with Blender's Normal pass, to compare with.

    The camera is written beside the file"""

    bl_label = "Render True Normals"

    output: FileSetting("File", "OpenEXR file to write. Empty: a name of its own in the output folder")

    def destination(self, scene: Any) -> tuple[RenderKind, Path]:
        return "normals", render_path(output_path(self.output, result_name(scene, "true_normals"), "EXR"))

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        self.rig(f"its true normals are in {result['output']}").photo.truth = result["output"]
        self.tell(f"True normals written to {result['output']}")


class MPS_OT_check_photo(RunsCore, bpy.types.Operator):
    """Say whether the photo is exposed and focused well, and what its lights reach, before it is used"""

    bl_label = "Check Photo"
    requires = "photo"

    def prepare(self, context: Any, folder: Path) -> tuple[Check, Sequence[Path]]:
        scene = context.scene
        image = scene.mps.photo.image
        if image.source == "MOVIE":
            raise InputError("a video is not checked as a whole; open one of its frames as a picture")
        photo = image_file(image, "photo", "render or open one first")
        rig = rig_path(scene, image, folder, rig_file_for(image, scene.mps.estimate))
        return Check(image=str(photo), rig=rig, **reading(scene.mps.estimate)), []

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        self.tell(_VERDICTS[result["level"]])
