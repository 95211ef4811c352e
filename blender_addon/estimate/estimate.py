"""The estimate: the photo becomes a normal map in camera space, in the core's process.

Beside it are its mask, and the error map: the angles between the normals and the true ones of the same view.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.capture.operations import FindMask
from mpsnet_core.errors import FileError, GeometryError, Note, SettingsError
from mpsnet_core.estimate.operations import Estimate
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.operations import CompareNormals

from ..image_records import Provenance, chosen, file_stamp, remember, remembered, sidecar, stamp
from ..images import frame_pattern, image_file, load_frames, load_image
from ..operators.core_run import RunsCore
from ..outputs import FORMATS, output_frames, output_path, overruled_format
from ..photo.camera import PLACES, chosen_camera, is_real, lens_stamp
from ..photo.options import network, painted_mask, reading, rig_and_camera_options, rig_file_for
from ..rig.rig import lights_provenance
from ..rig.several_rigs import OnEachRig, result_name
from ..scene.objects import by_session_uid, find_object
from ..settings.declared import StringSetting, options_of
from ..settings.estimate import EstimateSettings

# Tolerance of equal poses: files have this many digits.
_SAME_POSE = 1e-5


class MPS_OT_estimate(OnEachRig, EstimateSettings, bpy.types.Operator):
    """Estimate the surface normals that the photo shows"""

    bl_label = "Estimate Normals"
    step = "estimate"
    requires = "photo"

    surface: StringSetting(
        "Surface", "Name of the mesh object that gives each pixel's distance to near lights. Empty: the panel's"
    )

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        settings, photo = context.scene.mps.estimate, context.scene.mps.photo.image
        own_rig = rig_file_for(photo, settings) or (photo is not None and remembered(photo, "rig"))
        return {
            "Photo": stamp(photo),
            **({} if own_rig else {f"{name} of the rig": of for name, of in lights_provenance(context.scene).items()}),
            **chosen(settings, without=("output", "confidence", "albedo")),
            "White Photo": file_stamp(settings.white),
            **_painted(settings),
            "Rig File": file_stamp(rig_file_for(photo, settings)),
            **_lens_of_camera(context.scene),
        }

    def prepare(self, context: Any, folder: Path) -> tuple[Estimate, Sequence[Path]]:
        scene = context.scene
        image = scene.mps.photo.image
        photo = image_file(image, "photo", "render or open one first")
        rig_file = self.rig_file if "rig_file" in self._given else rig_file_for(image, scene.mps.estimate)
        self._moves = moves = image.source in {"SEQUENCE", "MOVIE"}
        if image.source == "SEQUENCE":
            photo = frame_pattern(photo)
        name = result_name(scene, "normals")
        self._output = output_frames(self.output, name) if moves else output_path(self.output, name, self.file_format)
        self._notes = self._unused(scene.mps.estimate, rig_file)
        # True for everything that Render Photo writes.
        self._omitted_notes = () if is_real(image) else ("read as linear (float file)",)
        if self.albedo and not self.white and not moves:
            raise SettingsError("the albedo is made from a white photo and none is named; choose one in Photo > Colour")
        if self.surface:
            scene.mps.estimate.surface = find_object(scene, self.surface)
        self._lens, self._photo = self.lens, image.session_uid
        self._stood = {what: remembered(image, what) for what in ("camera", PLACES)}
        confidence, albedo = (self._beside(what) if getattr(self, what) else None for what in ("confidence", "albedo"))
        of_one_photo, read = ("white", "white_light"), ("encoding", "dark", "flat")  # the latter are in `reading`
        unused = ("smooth",) if not moves else of_one_photo
        unused = unused if self.white else (*unused, *of_one_photo)
        operation = Estimate(
            image=(str(photo),),
            **rig_and_camera_options(context, image, folder, self.write_mesh, rig_file),
            **reading(self, painted=painted_mask(scene.mps.estimate, folder)),
            **network(self),
            **options_of(Estimate, self, without=("focal", "distance", "model", *read, *unused)),
            passes=None if moves or self.average_passes else 1,
            confidence=confidence,
            albedo=albedo,
            format=FORMATS[self.file_format] if moves else None,
            output=str(self._output),
        )
        pictures = [Path(file) for file in (confidence, albedo) if file is not None]
        return operation, [self._output / "frames" if moves else self._output, *pictures]

    def _unused(self, settings: Any, rig_file: str) -> list[Note]:
        """A sentence for each setting that has no effect on this photo."""
        notes = [] if self._moves else overruled_format(self._output, settings)
        if self.rig_file and not rig_file:
            words = "%s not used: a rendered photo has the rig it was rendered with"
            notes.insert(0, Note(words, Path(self.rig_file).name, level="look"))
        if self.white and self._moves:
            words = "%s not used: a white photo goes with one still photo"
            notes.append(Note(words, Path(self.white).name, level="look"))
        return notes

    def _beside(self, what: str) -> str | None:
        """The file of another result of a still photo, None for a sequence."""
        name = f"{self._output.stem}_{what}{self._output.suffix}"
        return None if self._moves else str(self._output.with_name(name))

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        estimate = self.rig(f"its normals are in {self._output}").estimate
        if self._moves:
            image = load_frames(Path(result["first_output"]), "MPS Normals Frames")
            estimate.first_frame, estimate.last_frame = result["first"], result["last"]
        else:
            image = load_image(self._output, "MPS Normals", is_data=True)
        # The bake uses the camera of this photo, not that of one that was estimated here before.
        for what, text in self._stood.items():
            remember(image, what, text)
        remember(image, "lens", f"{self._lens:g}")
        image.mps.photo = by_session_uid(bpy.data.images, self._photo)
        self.made(image)
        estimate.image = image
        estimate.albedo_image = None
        if "albedo" in result:
            estimate.albedo_image = self.loaded(Path(result["albedo"]), "MPS Albedo", is_data=False)
        self.tell(f"Normals written to {self._output}")


def _lens_of_camera(scene: Any) -> Provenance:
    """The lens of a real photo's camera object under distant lights, as provenance; empty if there is no such object.

    Normals that were estimated before their photo was aligned stay up to date.
    """
    photo = scene.mps.photo.image
    camera = chosen_camera(scene, photo) if photo and not scene.mps.estimate.lens else None
    return {"Camera's lens": lens_stamp(camera)} if camera else {}


def _painted(settings: Any) -> Provenance:
    """The painted mask as provenance, if it is used. Use packs it, see :func:`.painted_mask`."""
    image = settings.painted_mask
    if settings.mask != "PAINTED" or image is None:
        return {}
    return {"Painted Mask": f"{stamp(image)} {'painted on' if image.is_dirty else 'packed'}"}


class MPS_OT_show_mask(RunsCore, EstimateSettings, bpy.types.Operator):
    """Show which pixels of the photo count as the object, before they are used. The mask is written as a file, too"""

    bl_label = "Show Mask"
    requires, step = "photo", "estimate"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        only = ("encoding", "dark", "flat", "mask", "mask_file", "background", "threshold")
        shaping = chosen(context.scene.mps.estimate, only=only)
        return {"Photo": stamp(context.scene.mps.photo.image), **shaping, **_painted(context.scene.mps.estimate)}

    def prepare(self, context: Any, folder: Path) -> tuple[FindMask, Sequence[Path]]:
        scene = context.scene
        photo = image_file(scene.mps.photo.image, "photo", "render or open one first")
        mask = output_path("", result_name(scene, "mask"), "PNG")
        self._overlay = mask.with_name(f"{mask.stem}_shown.png")
        options = reading(self, painted=painted_mask(scene.mps.estimate, folder))
        operation = FindMask(image=str(photo), output=str(mask), overlay=str(self._overlay), **options)
        return operation, [mask, self._overlay]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        estimate = self.rig(f"its mask is in {result['output']}").estimate
        estimate.mask_image = self.loaded(self._overlay, "MPS Mask", is_data=False)
        self.tell(f"The object covers {result['share']:.1%} of the photo; mask written to {result['output']}")


class MPS_OT_error_map(RunsCore, bpy.types.Operator):
    """Compare the estimated normals with the true ones: the angle between them in colour, its mean and its median"""

    bl_label = "Error Map"
    requires = "estimate"

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or ("" if context.scene.mps.photo.truth else "Render the true normals first")

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        return {**super().provenance(context), "True Normals": file_stamp(context.scene.mps.photo.truth)}

    def prepare(self, context: Any, folder: Path) -> tuple[CompareNormals, Sequence[Path]]:
        scene = context.scene
        image = scene.mps.estimate.image
        if image.source == "SEQUENCE":
            raise SettingsError("the normals are a sequence; estimate one photo to compare it with its true normals")
        normals = image_file(image, "normal map", "estimate the normals first")
        truth = Path(bpy.path.abspath(scene.mps.photo.truth))
        if not truth.is_file():
            raise FileError(f"the true normals {truth} are gone; render them again")
        camera = sidecar(truth, "camera")
        self._check_view(image, camera, folder)
        self._output = output_path("", result_name(scene, "errors"), "PNG")
        operation = CompareNormals(normals=str(normals), truth=str(truth), camera=str(camera), output=str(self._output))
        return operation, [self._output]

    def _check_view(self, image: Any, camera: Path, folder: Path) -> None:
        """Raise InputError if the true normals are of another view than the photo."""
        taken_with, true = remembered(image, "camera"), read_camera(camera)
        if taken_with is None:
            return
        (folder / "camera.json").write_text(taken_with, encoding="utf-8")
        ours = read_camera(folder / "camera.json")
        apart = np.abs(ours.projection_rows() - true.projection_rows()).max()
        size = np.abs(true.projection_rows()).max()
        if (ours.width, ours.height) != (true.width, true.height) or apart > _SAME_POSE * size:
            raise GeometryError(
                "the true normals are of another view than the photo; render them again, or the photo and its normals"
            )

    def remarks(self, result: dict[str, Any]) -> Sequence[Note]:
        return [Note("mean error %.2f°, median %.2f°", result["mean"], result["median"])]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        estimate = self.rig(f"its error map is in {self._output}").estimate
        estimate.error_image = self.loaded(self._output, "MPS Errors", is_data=False)
