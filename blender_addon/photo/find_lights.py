"""Calibration of real lights: directions by a mirror ball, a mesh or the photo itself, mixing by a grey ball."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import bpy
from bpy.app.handlers import persistent

from mpsnet_core.calibrate.operations import CalibrateLights, CalibrateMesh, CalibrateMixing
from mpsnet_core.errors import InputError, Note
from mpsnet_core.estimate.operations import CalibratePhoto
from mpsnet_core.operation import Operation

from ..image_records import from_json
from ..images import frame_pattern, image_file
from ..operators.core_run import RunsCore, idle
from ..outputs import file_name, is_permanent, requested_path
from ..preferences import output_folder
from ..rig.several_rigs import result_name
from ..settings.declared import apply_given_settings, options_of
from ..settings.photo import CalibrateSettings
from .align import mesh_of_photo
from .camera import lacks_photo_camera, write_photo_camera
from .options import painted_mask, reading

_OVERLAY = "MPS Calibration"
# Words that occur in these tables alone; the panel translates them.
CHANNEL, UNEXPLAINED = "Channel", "Unexplained"
# Degrees by which equation 2 may be off on a grey ball, and above which the rig is not to be used.
_TOLERABLE, _MISFIT = 5.0, 15.0


class _Calibrates(RunsCore, CalibrateSettings):
    """Common to both calibrations: a rig file as output, of photos of a ball with an overlay image."""

    _overlay: Path | None = None

    def _outputs_named(self, what: str = "") -> list[Path]:
        """The files to write: the rig's, and what is drawn over the photo of a ball."""
        named = f"{file_name(result_name(bpy.context.scene, 'rig'))}.json"
        rig = self._rig = requested_path(self.output) if self.output else output_folder() / named
        if rig.suffix.lower() != ".json":
            raise InputError(f"a rig file's name ends in .json, that of {rig} does not; change it")
        self._overlay = rig.with_name(f"{rig.stem}_{what}.png") if what else None
        return [rig, self._overlay] if self._overlay else [rig]

    def _options(self, balls: int) -> dict[str, Any]:
        """The core's options for the ball and the output files."""
        circles = [(self.circle_x, self.circle_y, self.circle_radius)]
        circles += [(self.second_x, self.second_y, self.second_radius)] if balls > 1 else []
        return {
            **options_of(CalibrateLights, self),
            "circle": tuple(f"{x:g},{y:g},{radius:g}" for x, y, radius in circles) if circles[0][2] > 0 else (),
            "overlay": str(self._overlay),
            "output": str(self._rig),
        }

    def _show_results(self, table: Sequence[Sequence[str]]) -> None:
        """Show the overlay, if any, and the table of results (headings first), and use the rig for estimates.

        Rows with only two cells are shown as separate lines below the table.
        """
        result_is = f"the rig is in {self._rig}"
        estimate, settings = self.rig(result_is).estimate, self.scene(result_is).mps.calibrate
        settings.image = self.loaded(self._overlay, _OVERLAY, is_data=False) if self._overlay else None
        settings.summary = "\n".join("|".join(row) for row in table)
        estimate.rig_file = str(self._rig)
        if from_ball(self) and self.lens and not estimate.lens:
            estimate.lens = self.lens
            self.tell(f"The lens of {self.lens:g} mm counts for the photo, too")
        text = None if is_permanent(self._rig) else self._rig.read_text(encoding="utf-8")
        estimate.kept_rig = json.dumps([str(self._rig), text]) if text else ""
        self.tell(f"Rig written to {self._rig}; photos are estimated with it from now on")


class MPS_OT_calibrate_lights(_Calibrates, bpy.types.Operator):
    """Find the three lights by a mirror ball, the target's mesh or the photo, and write a rig file for the estimate"""

    bl_label = "Find Lights"

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene = context.scene
        if from_ball(scene.mps.calibrate):
            return "" if scene.mps.calibrate.ball else "Choose a photo of a mirror ball in the object's place"
        photo = scene.mps.photo.image
        if photo is None:
            return "Open a photo first"
        if scene.mps.calibrate.source == "PHOTO":
            return ""
        if mesh_of_photo(context) is None:
            return "Choose the target, the mesh object that the photo shows"
        lacking = lacks_photo_camera(scene, photo)
        return "Align the photo with the mesh first: press Align Photo in the step Photo" if lacking else ""

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context)  # what a script gives may not be in the scene yet

    def prepare(self, context: Any, folder: Path) -> tuple[Operation, Sequence[Path]]:
        given, calibrate = self.properties.is_property_set, context.scene.mps.calibrate
        if given("ball") and not given("source"):
            self.source = calibrate.source if from_ball(calibrate) else "BALL"
        apply_given_settings(self, calibrate)
        self.refuse_lacking(context)
        if not from_ball(self):
            return self._by_photo(context, folder)
        photos = [_photo(self.ball, "the mirror ball")]
        if self.source == "LAMPS":
            photos += [_photo(self.second_light, "the second light"), _photo(self.third_light, "the third light")]
        elif self.second_ball:
            photos.append(_photo(self.second_ball, "the mirror ball at its second place"))
        outputs, per_light = self._outputs_named("lights"), self.source == "LAMPS"
        return CalibrateLights(ball=tuple(photos), per_light=per_light, **self._options(places_of_ball(self))), outputs

    def _by_photo(self, context: Any, folder: Path) -> tuple[Operation, Sequence[Path]]:
        """The core's operation for the lights of the photo, alone or by the mesh that it shows."""
        scene = context.scene
        image, estimate, outputs = scene.mps.photo.image, scene.mps.estimate, self._outputs_named()
        photo = image_file(image, "photo", "open it again")
        if image.source == "MOVIE":
            raise InputError(f"{photo.name} is a video; open one of its frames as a picture")
        read = reading(estimate, painted=painted_mask(estimate, folder))
        if self.source == "PHOTO":
            photo = frame_pattern(photo) if image.source == "SEQUENCE" else photo
            return CalibratePhoto(image=(str(photo),), output=str(self._rig), **read), outputs
        camera, mesh = folder / "camera.json", folder / "mesh.npz"
        write_photo_camera(camera, scene, image)
        self.write_mesh(context, mesh, mesh_of_photo(context))
        return CalibrateMesh(
            image=(str(photo),), mesh=str(mesh), camera=str(camera), output=str(self._rig), **read
        ), outputs

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        lights = [
            (light["name"].title(), f"{light['slant']:.1f}°", f"{light['tilt']:.1f}°", f"{light['uncertainty']:.1f}°")
            for light in result["lights"]
        ]
        self._show_results([("", "Slant", "Tilt", "±"), *lights])


class MPS_OT_calibrate_mixing(_Calibrates, bpy.types.Operator):
    """Find in the photo of a matt grey ball how the lights' colours mix, and add it to the rig file"""

    bl_label = "Find Mixing"

    def prepare(self, context: Any, folder: Path) -> tuple[CalibrateMixing, Sequence[Path]]:
        scene = context.scene
        apply_given_settings(self, scene.mps.calibrate)
        lights = scene.mps.estimate.rig_file
        if not lights:
            raise InputError("where are the lights? Find them first, or name a rig file in the step Rig")
        photo = _photo(self.grey, "the grey ball")
        outputs = self._outputs_named("mixing")
        return CalibrateMixing(photo=(photo,), rig=bpy.path.abspath(lights), **self._options(1)), outputs

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        rows = zip("RGB", result["mixing"], strict=True)
        channels = [(channel, *(f"{value:.3f}" for value in row)) for channel, row in rows]
        unexplained = (UNEXPLAINED, f"{result['residual']:.1%}")
        self._show_results([(CHANNEL, "Red", "Green", "Blue"), *channels, unexplained])

    def remarks(self, result: dict[str, Any]) -> Sequence[Note]:
        off = result["equation_2_error"]
        if off is None:
            return ()
        if off <= _TOLERABLE:
            return [Note("equation 2 fits the grey ball within %.1f°", off)]
        words = "equation 2 is %.1f° off on the grey ball: is the ball matt, and is the rig file this photo's?"
        return [Note(words, off, level="look" if off <= _MISFIT else "stop")]


def from_ball(settings: Any) -> bool:
    """Whether the lights are found by photos of a mirror ball."""
    return settings.source in {"BALL", "LAMPS"}


def places_of_ball(settings: Any) -> int:
    """At how many places the photos show the mirror ball."""
    return 2 if settings.source == "BALL" and settings.second_ball else 1


def _photo(path: str, what: str) -> str:
    if not path:
        raise InputError(f"no photo of {what} is named; choose one")
    return bpy.path.abspath(path)


@persistent
def _write_kept_rigs(*_: Any) -> None:
    """Write the rig files that the open .blend file keeps, as those that they are copies of go with a Blender."""
    estimates = (one.estimate for scene in bpy.data.scenes if not scene.library for one in scene.mps.every_rig)
    for estimate in estimates:
        file, text = [*from_json(estimate.kept_rig, list), None, None][:2]
        if not isinstance(text, str) or file != estimate.rig_file:
            continue
        # A hostile file may hold any text. The panel then says that the rig file does not exist.
        with suppress(OSError, ValueError):
            # The rig of another .blend file that this Blender had open may have the same name.
            folder = Path(bpy.app.tempdir) / f"rig_{crc32(text.encode()):08x}"
            rig = folder / f"{file_name(Path(file).stem)}.json"
            folder.mkdir(exist_ok=True)
            rig.write_text(text, encoding="utf-8")
            estimate.rig_file, estimate.kept_rig = str(rig), json.dumps([str(rig), text])


HANDLERS = {"load_post": _write_kept_rigs}
