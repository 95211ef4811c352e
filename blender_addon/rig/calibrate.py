"""Calibration of real lights from photos of a mirror ball (directions) and a grey ball (mixing)."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import bpy
from bpy.app.handlers import persistent

from mpsnet_core.calibrate.operations import CalibrateLights, CalibrateMixing
from mpsnet_core.errors import InputError

from ..image_records import from_json
from ..images import fine_preview, load_image
from ..operators.core_run import RunsCore
from ..outputs import file_name, is_permanent, requested_path
from ..preferences import output_folder
from ..settings.calibrate import CalibrateSettings
from ..settings.declared import apply_given_settings, options_of
from .several_rigs import all_rigs, result_name, rig_at

_OVERLAY = "MPS Calibration"
# Words that occur in these tables alone; the panel translates them.
CHANNEL, UNEXPLAINED, EQUATION_2 = "Channel", "Unexplained", "Equation 2 Error"


class _Calibrates(RunsCore, CalibrateSettings):
    """Common to both calibrations: photos of a ball as input, a rig file and an overlay image as output."""

    def _options(self, what: str, balls: int) -> dict[str, Any]:
        """The core's options for the ball and the output files."""
        rig = self._rig = self._rig_path(file_name(result_name(bpy.context.scene, "rig")))
        self._overlay = rig.with_name(f"{rig.stem}_{what}.png")
        circles = [(self.circle_x, self.circle_y, self.circle_radius)]
        circles += [(self.second_x, self.second_y, self.second_radius)] if balls > 1 else []
        return {
            **options_of(CalibrateLights, self),
            "circle": tuple(f"{x:g},{y:g},{radius:g}" for x, y, radius in circles) if circles[0][2] > 0 else (),
            "overlay": str(self._overlay),
            "output": str(rig),
        }

    def _rig_path(self, name: str) -> Path:
        """The rig file to write: the one that the settings name, or `name` in the output folder."""
        path = requested_path(self.output) if self.output else output_folder() / f"{name}.json"
        if path.suffix.lower() != ".json":
            raise InputError(f"a rig file's name ends in .json, that of {path} does not; change it")
        return path

    def _show_results(self, table: Sequence[Sequence[str]]) -> None:
        """Show the overlay and the table of results (headings first), and use the rig for estimates.

        Rows with only two cells are shown as separate lines below the table.
        """
        result_is = f"the rig is in {self._rig}"
        scene = self.scene(result_is)
        estimate = rig_at(scene, self._rig_place, result_is).estimate
        settings = scene.mps.calibrate
        image = load_image(self._overlay, _OVERLAY, is_data=False)
        if not bpy.app.background:
            fine_preview(image)
        self.made(image)
        settings.image = image
        settings.summary = "\n".join("|".join(row) for row in table)
        estimate.rig_file = str(self._rig)
        text = None if is_permanent(self._rig) else self._rig.read_text(encoding="utf-8")
        estimate.kept_rig = json.dumps([str(self._rig), text]) if text else ""
        self.tell(f"Rig written to {self._rig}; photos are estimated with it from now on")


class MPS_OT_calibrate_lights(_Calibrates, bpy.types.Operator):
    """Find the three lights in the photo of a mirror ball, and write a rig file that the estimate then uses"""

    bl_idname = "mps.calibrate_lights"
    bl_label = "Find Lights"

    def prepare(self, context: Any, folder: Path) -> tuple[CalibrateLights, Sequence[Path]]:
        apply_given_settings(self, context.scene.mps.calibrate)
        photos = [_photo(self.ball, "the mirror ball")]
        if self.second_ball:
            photos.append(_photo(self.second_ball, "the mirror ball at its second place"))
        operation = CalibrateLights(ball=tuple(photos), **self._options("lights", len(photos)))
        return operation, [self._rig, self._overlay]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        lights = [
            (light["name"].title(), f"{light['slant']:.1f}°", f"{light['tilt']:.1f}°", f"{light['uncertainty']:.1f}°")
            for light in result["lights"]
        ]
        self._show_results([("", "Slant", "Tilt", "±"), *lights])


class MPS_OT_calibrate_mixing(_Calibrates, bpy.types.Operator):
    """Find in the photo of a matt grey ball how the lights' colours mix, and add it to the rig file"""

    bl_idname = "mps.calibrate_mixing"
    bl_label = "Find Mixing"

    def prepare(self, context: Any, folder: Path) -> tuple[CalibrateMixing, Sequence[Path]]:
        scene = context.scene
        apply_given_settings(self, scene.mps.calibrate)
        lights = scene.mps.estimate.rig_file
        if not lights:
            raise InputError("where are the lights? Find them first, or name a rig file in the step Rig")
        photo = _photo(self.grey, "the grey ball")
        operation = CalibrateMixing(photo=(photo,), rig=bpy.path.abspath(lights), **self._options("mixing", 1))
        return operation, [self._rig, self._overlay]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        rows = zip("RGB", result["mixing"], strict=True)
        channels = [(channel, *(f"{value:.3f}" for value in row)) for channel, row in rows]
        unexplained = (UNEXPLAINED, f"{result['residual']:.1%}")
        off = result["equation_2_error"]
        equation_2 = [] if off is None else [(EQUATION_2, f"{off:.1f}°")]
        self._show_results([(CHANNEL, "Red", "Green", "Blue"), *channels, unexplained, *equation_2])


def _photo(path: str, what: str) -> str:
    if not path:
        raise InputError(f"no photo of {what} is named; choose one")
    return bpy.path.abspath(path)


@persistent
def _write_kept_rigs(*_: Any) -> None:
    """Write the rig files that the open .blend file keeps, as those that they are copies of go with a Blender."""
    estimates = (one.estimate for scene in bpy.data.scenes if not scene.library for one in all_rigs(scene))
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
