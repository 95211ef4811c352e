"""The estimate: the photo becomes a normal map in camera space, in the core's process."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.capture.operations import FindMask
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.operations import Estimate
from mpsnet_core.scene.camera import write_camera
from mpsnet_core.scene.rig import LightRig, read_rig, write_rig

from ..bake.bake import named_object
from ..bake.mesh_file import begin_mesh
from ..operators import RunsCore, Slices, as_typed, same
from ..outputs import (
    FORMATS,
    ending_wins,
    fine_preview,
    frame_pattern,
    image_file,
    load_frames,
    load_image,
    output_frames,
    output_path,
    picture_size,
    remember,
    remembered,
)
from ..photo.camera import chosen_camera, write_photo_camera
from ..preferences import preference
from ..provenance import Provenance, chosen, file_stamp, made_by, rounded, stamp
from ..rig.rig import light_rig, rig_camera, scene_camera
from ..rig.several_rigs import result_name, rig_at
from ..settings.declared import take_given
from ..settings.estimate import MODELS, EstimateSettings


class MPS_OT_estimate(RunsCore, EstimateSettings, bpy.types.Operator):
    """Estimate the surface normals that the photo shows"""

    bl_idname = "mps.estimate"
    bl_label = "Estimate Normals"
    bl_options = {"UNDO"}

    surface: StringProperty(
        name="Surface",
        description="Name of the mesh object that tells how far each pixel is from near lights. Empty: the panel's",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.photo.image else "Render or open a photo first"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        settings = context.scene.mps.estimate
        return {
            "Photo": stamp(context.scene.mps.photo.image),
            **chosen(EstimateSettings, settings, without=("output", "confidence", "albedo")),
            "White Photo": file_stamp(settings.white),
            "Rig File": file_stamp(rig_file_for(context.scene.mps.photo.image, settings)),
            "Camera's lens": _lens_of_camera(context.scene),
        }

    def prepare(self, context: Any, folder: Path) -> tuple[Estimate, Sequence[Path]]:
        scene = context.scene
        named = self.properties.is_property_set("rig_file")
        take_given(self, EstimateSettings, scene.mps.estimate)
        image = scene.mps.photo.image
        photo = image_file(image, "photo", "render or open one first")
        rig_file = self.rig_file if named else rig_file_for(image, scene.mps.estimate)
        notes: list[str] = []
        if self.rig_file and not rig_file:
            notes = [f"{Path(self.rig_file).name} not used: a rendered photo has the rig it was rendered with"]
        self._moves = image.source in {"SEQUENCE", "MOVIE"}
        if self._moves:
            photo = frame_pattern(photo) if image.source == "SEQUENCE" else photo
            output = output_frames(self.output, result_name(scene, "normals"))
        else:
            output = output_path(self.output, result_name(scene, "normals"), self.file_format)
            notes += ending_wins(output, scene.mps.estimate)
        self._notes = notes
        if self.albedo and not self.white and not self._moves:
            raise InputError(
                "the albedo is made from a white photo and none is named; choose one in Photo > Real Photo"
            )
        if self.surface:
            scene.mps.estimate.surface = named_object(scene, self.surface)
        options = rig_and_camera_options(context, image, folder, self.later, rig_file)
        options |= {**reading(self), **network(self)}
        if self._moves:
            options |= {"smooth": self.smooth, "format": FORMATS[self.file_format]}
        elif not self.average_passes:
            options["passes"] = 1
        outputs = [output / "frames" if self._moves else output]
        if self.white and self._moves:
            notes.append(f"{Path(self.white).name} not used: a white photo goes with one still photo")
        elif self.white:
            options["white"] = (bpy.path.abspath(self.white),)
        wanted = () if self._moves else ("confidence", "albedo")
        for also in filter(partial(getattr, self), wanted):
            outputs.append(output.with_name(f"{output.stem}_{also}{output.suffix}"))
            options[also] = str(outputs[-1])
        self._output, self._camera, self._lens = output, remembered(image, "camera"), self.lens
        self._photo = image.session_uid
        return Estimate(image=(str(photo),), output=str(output), **options), outputs

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        result_is = f"its normals are in {self._output}"
        estimate = rig_at(self.scene(result_is), self._rig_place, result_is).estimate
        if self._moves:
            image = load_frames(Path(result["first_output"]), "MPS Normals Frames")
            estimate.first_frame, estimate.last_frame = result["first"], result["last"]
        else:
            image = load_image(self._output, "MPS Normals", is_data=True)
        # The bake takes the camera as it stood for this photo, not for one that was estimated here before.
        remember(image, "camera", self._camera)
        remember(image, "lens", f"{self._lens:g}")
        image.mps.photo = same(bpy.data.images, self._photo)
        self.made(image)
        estimate.image = image
        estimate.albedo_image = None
        if "albedo" in result:
            estimate.albedo_image = load_image(Path(result["albedo"]), "MPS Albedo", is_data=False)
            self.made(estimate.albedo_image)
        self.report({"INFO"}, f"Normals written to {self._output}")


def _lens_of_camera(scene: Any) -> str:
    """What counts of the camera object of a real photo under distant lights."""
    photo = scene.mps.photo.image
    camera = chosen_camera(scene, photo) if photo and not scene.mps.estimate.lens else None
    return rounded([camera.data.lens, camera.data.ortho_scale], 4) if camera else ""


class MPS_OT_show_mask(RunsCore, EstimateSettings, bpy.types.Operator):
    """Show which pixels of the photo count as the object, before they are used. The mask is written as a file, too"""

    bl_idname = "mps.show_mask"
    bl_label = "Show Mask"
    bl_options = {"UNDO"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        return MPS_OT_estimate.lacks(context)

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        only = ("encoding", "dark", "flat", "mask", "mask_file", "background", "threshold")
        shaping = chosen(EstimateSettings, context.scene.mps.estimate, only=only)
        return {"Photo": stamp(context.scene.mps.photo.image), **shaping}

    def prepare(self, context: Any, folder: Path) -> tuple[FindMask, Sequence[Path]]:
        scene = context.scene
        take_given(self, EstimateSettings, scene.mps.estimate)
        photo = image_file(scene.mps.photo.image, "photo", "render or open one first")
        mask = output_path("", result_name(scene, "mask"), "PNG")
        self._overlay = mask.with_name(f"{mask.stem}_shown.png")
        operation = FindMask(image=str(photo), output=str(mask), overlay=str(self._overlay), **reading(self))
        return operation, [mask, self._overlay]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        result_is = f"its mask is in {result['output']}"
        estimate = rig_at(self.scene(result_is), self._rig_place, result_is).estimate
        estimate.mask_image = image = load_image(self._overlay, "MPS Mask", is_data=False)
        self.made(image)
        fine_preview(image)
        self.report(
            {"INFO"}, f"The object covers {result['share']:.1%} of the photo; mask written to {result['output']}"
        )


def rig_file_for(photo: Any, settings: Any) -> str:
    """The rig file that the settings name, if it is for this photo; else "".

    A photo that was rendered here keeps its rig with it: a file that was measured for another photo is not for it.
    """
    rendered = photo is not None and made_by(photo) == "render_photo" and remembered(photo, "rig") is not None
    return "" if rendered else settings.rig_file


def rig_and_camera_options(
    context: Any, image: Any, folder: Path, later: Callable[[Slices], None], rig_file: str | None = None
) -> dict[str, Any]:
    """The core's options for the rig and the camera that the photo was taken with, by the scene's settings.

    later: that of the operator, see :class:`.RunsCore`.
    rig_file: the rig's file, "" for none, None for that of the settings where it is for this photo.
    """
    scene = context.scene
    if rig_file is None:
        rig_file = rig_file_for(image, scene.mps.estimate)
    rig = rig_path(scene, image, folder, rig_file)
    return {"rig": str(rig), **_viewpoint_options(context, image, read_rig(rig), folder, later)}


def rig_path(scene: Any, image: Any, folder: Path, rig_file: str) -> Path:
    """The file of the rig that a photo was taken with: `rig_file`, else what the photo keeps, else the scene's rig."""
    if rig_file:
        return Path(bpy.path.abspath(rig_file))
    rig, taken_with = folder / "rig.json", remembered(image, "rig")
    if taken_with is None:
        write_rig(rig, light_rig(scene))
    else:
        rig.write_text(taken_with, encoding="utf-8")
    return rig


def _viewpoint_options(
    context: Any, image: Any, rig: LightRig, folder: Path, later: Callable[[Slices], None]
) -> dict[str, Any]:
    """The camera that took the photo, and for near lights how far the object is from it."""
    scene = context.scene
    settings = scene.mps.estimate
    distance = {"distance": as_typed(settings.distance)} if settings.distance and rig.near is not None else {}
    seen = seen_through(scene, image, settings.lens, folder)
    if rig.near is not None and not seen:
        raise InputError(
            "the rig's lights stand near the object, so the photo's camera counts; tell its lens, or add a rig, "
            "whose camera is taken"
        )
    if rig.near is None or distance or settings.surface is None or settings.lens:
        return {**seen, **distance}
    context.view_layer.update()
    depsgraph = context.evaluated_depsgraph_get()
    later(begin_mesh(folder / "surface.npz", settings.surface, depsgraph, None).slices)
    return {**seen, "mesh": str(folder / "surface.npz")}


def seen_through(scene: Any, image: Any, lens: float, folder: Path) -> dict[str, Any]:
    """The core's option for a picture's camera: its lens where that is known, else the camera that took it, else the
    rig's; nothing where there is none.

    lens: focal length in mm on a sensor 36 mm wide, 0 for none.
    """
    camera = folder / "camera.json"
    if lens:
        return {"focal": as_typed(lens)}
    if not write_photo_camera(camera, scene, image):
        if not scene.mps.rig.lights:
            return {}
        write_camera(camera, scene_camera(rig_camera(scene), scene, picture_size(image)))
    return {"camera": str(camera)}


def network(settings: Any) -> dict[str, Any]:
    """The core's options for the settings' model and, by the preferences, for what networks run on."""
    provider, threads = preference("provider").lower(), preference("threads")
    return {"model": model_name(settings), "provider": provider, "threads": threads}


def model_name(settings: Any) -> str:
    """The model as the core knows it. Raises InputError where it is a file and none is named."""
    if settings.model != "FILE":
        return MODELS[settings.model].name
    if not settings.model_file:
        raise InputError("the model is a file but none is named; choose an .onnx file")
    return bpy.path.abspath(settings.model_file)


def reading(settings: Any, unmasked: str = "alpha-or-auto") -> dict[str, Any]:
    """The core's options for how a photo is read: encoding, dark frame, flat field and mask.

    unmasked: the mask unless one is chosen.

    Raises InputError where a file is chosen and none is named.
    """
    return {**reading_options_without_mask(settings), "mask": _mask(settings) or unmasked}


def reading_options_without_mask(settings: Any) -> dict[str, Any]:
    """The same but for the mask."""
    frames = {frame: bpy.path.abspath(path) for frame in ("dark", "flat") if (path := getattr(settings, frame))}
    return {"encoding": settings.encoding.lower(), **frames}


def _mask(settings: Any) -> str:
    if settings.mask == "FILE":
        if not settings.mask_file:
            raise InputError("the mask is a file but none is named; choose a picture")
        return bpy.path.abspath(settings.mask_file)
    if settings.mask == "BACKGROUND":
        if not settings.background:
            raise InputError("the mask comes from a background photo but none is named; choose one")
        return f"background:{bpy.path.abspath(settings.background)}"
    if settings.mask == "THRESHOLD":
        return f"threshold:{settings.threshold:g}"
    return {"AUTO": "", "FIND": "auto"}.get(settings.mask, settings.mask.lower())


CLASSES = (MPS_OT_estimate, MPS_OT_show_mask)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
