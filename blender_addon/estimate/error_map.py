"""The error map: angles between the estimated normals and the true ones rendered for the same view."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.errors import FileError, GeometryError, Note, SettingsError
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.operations import CompareNormals

from ..image_records import remembered, sidecar
from ..images import image_file, load_image
from ..operators.core_run import RunsCore
from ..outputs import output_path
from ..provenance import Provenance, file_stamp, stamp
from ..rig.several_rigs import result_name, rig_at

# Tolerance of equal poses: files have this many digits.
_SAME_POSE = 1e-5


class MPS_OT_error_map(RunsCore, bpy.types.Operator):
    """Compare the estimated normals with the true ones: the angle between them in colour, its mean and its median"""

    bl_idname = "mps.error_map"
    bl_label = "Error Map"
    requires = "estimate"

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or ("" if context.scene.mps.photo.truth else "Render the true normals first")

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        mps = context.scene.mps
        return {"Normals": stamp(mps.estimate.image), "True Normals": file_stamp(mps.photo.truth)}

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
        result_is = f"its error map is in {self._output}"
        estimate = rig_at(self.scene(result_is), self._rig_place, result_is).estimate
        estimate.error_image = image = load_image(self._output, "MPS Errors", is_data=False)
        self.made(image)
