"""Scan: from a photo and a mesh of the object to the texture, step by step, without a rig and a calibration."""

from collections.abc import Callable, Sequence
from typing import Any

import bpy

from mpsnet_core.calibrate.mesh_operation import POOR
from mpsnet_core.errors import InputError

from ..bake.bake_operator import check_shows_normals
from ..bake.before_after import draw_results
from ..bake.unwrap import lacks_uvs, unwrap
from ..operators.chain import Call, RunsSteps, run_operator
from ..operators.core_run import idle
from ..photo.align import mesh_of_photo
from ..photo.camera import chosen_camera, lacks_photo_camera
from ..photo.options import finds_lights, rig_file_for
from ..scene.objects import find_object
from ..scene.surfaces import middle_of
from ..settings.declared import FileSetting, StringSetting
from ..settings.record import result_of
from .try_it import look_at

# From how far the result is shown, in the target's largest dimension.
_AWAY = 2.0


class MPS_OT_scan(RunsSteps, bpy.types.Operator):
    """Make a texture of the photo on the target's mesh: find the camera and the lights, unwrap, estimate and bake.

    What is known already is kept. Each result is shown in its own step. It stops where it is unsure, and says why"""

    bl_idname = "mps.scan"
    bl_label = "Scan"
    drawn = staticmethod(draw_results)
    first_message = "looking at the mesh"

    photo: FileSetting("Photo", "Photo of the object to open first. Empty: the one that is open")
    target: StringSetting("Target", "Name of the mesh object in the photo. Empty: the target, else the active one")

    @classmethod
    def lacks(cls, context: Any) -> str:
        if context.scene.mps.photo.image is None:
            return "Open a photo of the object first"
        return "" if mesh_of_photo(context) else "Select the mesh object that the photo shows"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context)  # a script may give the photo and the target

    def steps(self) -> Sequence[Callable[[Any], Call | None]]:
        return self._prepare, self._align, self._lights, self._estimate, self._bake, self._present

    def _prepare(self, context: Any) -> None:
        scene = context.scene
        if self.photo:
            run_operator(bpy.ops.mps.open_photo, filepath=self.photo)
        if self.target:
            scene.mps.bake.target = find_object(scene, self.target)
        self.refuse_lacking(context)
        if scene.mps.photo.image.source != "FILE":
            raise InputError("a scan is made of one photo, and this is a sequence or a video; open one of its frames")
        scene.mps.bake.target = target = mesh_of_photo(context)
        if scene.mps.bake.assign:
            check_shows_normals(target)  # before minutes of work
        if lacks_uvs(target):
            unwrap(context, target)
            self.tell(f'"{target.name}" had no UVs and was unwrapped')

    def _align(self, context: Any) -> Call | None:
        scene = context.scene
        photo = scene.mps.photo.image
        camera = chosen_camera(scene, photo)
        of_another = bool(photo.mps.fit) and camera is not None and camera.parent not in (None, scene.mps.bake.target)
        return ("align_photo", {}) if lacks_photo_camera(scene, photo) or photo.mps.poor or of_another else None

    def _lights(self, context: Any) -> Call | None:
        scene = context.scene
        photo = scene.mps.photo.image
        if photo.mps.poor:
            raise InputError(
                f"the mesh fits the photo poorly ({photo.mps.fit}); pick points in Photo > Camera, or look at the "
                "mask, and press Scan again"
            )
        self._by_mesh = finds_lights(scene, photo, rig_file_for(photo, scene.mps.estimate))
        return ("calibrate_lights", {"source": "MESH"}) if self._by_mesh else None

    def _estimate(self, context: Any) -> Call:
        estimate = context.scene.mps.estimate
        if self._by_mesh and result_of(context.scene.mps, "calibrate_lights").get("residual", 0) > POOR:
            estimate.rig_file = ""
            raise InputError(
                "the mesh explains the photo's shading badly, so its lights are not sure; look at Photo > Camera, or "
                "find the lights from Photo in the step Lights, and press Scan again"
            )
        return "estimate", {"albedo": bool(estimate.white)}

    def _bake(self, context: Any) -> Call:
        return "bake", {"objects": "ACTIVE"}

    def _present(self, context: Any) -> None:
        scene = context.scene
        target = scene.mps.bake.target
        if not bpy.app.background and target is not None and target.visible_get():
            bpy.ops.object.select_all(action="DESELECT")
            target.select_set(True)
            camera = chosen_camera(scene, scene.mps.photo.image)
            if camera is not None:  # the side that the photo shows
                look_at(context, middle_of(target), _AWAY * max(target.dimensions), camera.matrix_world.to_quaternion())
            if scene.mps.relight.lamp is None:
                run_operator(bpy.ops.mps.relight)
        self.tell("The object has the photo's normals as its texture. To stop the lamp press Relight in 4 Bake")
