"""The check of a photo's exposure, lights and focus, before normals are estimated from it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.capture.operations import Check
from mpsnet_core.errors import InputError

from ..images import image_file
from ..operators.core_run import RunsCore
from .options import reading, rig_file_for, rig_path

_VERDICTS = {"good": "The photo is good", "watch": "The photo can be used", "bad": "The photo should be taken again"}


class MPS_OT_check_photo(RunsCore, bpy.types.Operator):
    """Say whether the photo is exposed and focused well, and what its lights reach, before it is used"""

    bl_idname = "mps.check_photo"
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
