"""Align Photo: finds the camera of a real photo from the mesh that it shows."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from mpsnet_core.errors import InputError
from mpsnet_core.estimate.alignment.operations import Align, fit_in_words
from mpsnet_core.scene.camera import FULL_FRAME, Camera, read_camera, write_camera

from ..image_records import Provenance, stamp
from ..images import image_file, picture_size
from ..operators.core_run import RunsCore
from ..operators.reporting import ReportingOperator
from ..outputs import output_path
from ..rig.several_rigs import result_name
from ..scene.camera import scene_camera
from ..scene.objects import by_session_uid, check_in_scene, find_object, target_of
from ..scene.surfaces import middle_of
from ..settings.declared import IntSetting, StringSetting, from_option, round_as_typed
from ..settings.photo import AlignSettings
from .camera import chosen_camera, is_real, take_pairs_along
from .options import network, painted_mask, reading, rig_file_for, rig_path

# Marks a camera object that was created here and so may be moved; others are the user's own.
_MADE_HERE = "mpsnet_aligned"


class MPS_OT_align_photo(RunsCore, AlignSettings, bpy.types.Operator):
    """Find the camera that took a real photo from the mesh that it shows, and bake through that camera.

    Four pairs of points or more place it first, where there are any; the photo's outline and normals refine it"""

    bl_label = "Align Photo"
    step = "align"

    target: StringSetting(
        "Target", "Name of the mesh object that the photo shows. Empty: the target of the bake, else the active one"
    )
    lens: from_option(Align, "focal", name="Lens (mm)", unset="that of the photo; estimated too where that is 0")
    lens_of: StringSetting(
        "Lens Of",
        "Name of a camera object whose focal length and shift the photo's camera gets. Empty: the one in "
        "the panel, unless Lens (mm) is given",
    )

    @classmethod
    def lacks(cls, context: Any) -> str:
        photo = context.scene.mps.photo.image
        if photo is None:
            return "Open a photo that you took first"
        if not is_real(photo):
            return "A rendered photo has its camera; open one that you took"
        return "" if mesh_of_photo(context) else "Choose the target, the mesh object that the photo shows"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        return {"Photo": stamp(context.scene.mps.photo.image)}

    def prepare(self, context: Any, folder: Path) -> tuple[Align, Sequence[Path]]:
        scene = context.scene
        photo, estimate = scene.mps.photo.image, scene.mps.estimate
        file = image_file(photo, "photo", "open it again")
        if photo.source == "MOVIE":
            raise InputError(f"{file.name} is a video; open one of its frames as a picture and align that")
        target = find_object(scene, self.target) if self.target else mesh_of_photo(context)
        self.write_mesh(context, folder / "mesh.npz", target)
        take_pairs_along(photo, target)
        overlay = output_path("", result_name(scene, "alignment"), "PNG")
        self._camera, self._overlay = overlay.with_name(f"{overlay.stem}_camera.json"), overlay
        self._photo, self._target = photo.session_uid, target.session_uid
        operation = Align(
            image=str(file),
            mesh=str(folder / "mesh.npz"),
            rig=rig_path(scene, photo, folder, rig_file_for(photo, estimate)),
            **self._place(context, photo, folder),
            **self._lens(scene, photo, folder),
            **reading(estimate, painted=painted_mask(estimate, folder)),
            **network(estimate),
            overlay=str(overlay),
            output=str(self._camera),
        )
        return operation, [self._camera, overlay]

    def _lens(self, scene: Any, photo: Any, folder: Path) -> dict[str, Any]:
        """The core's option for the lens; empty if it is to be estimated."""
        given = self.properties.is_property_set("lens")
        camera = scene.mps.align.lens_of if not given else None
        if self.lens_of and self.lens:
            raise InputError(
                f"the lens is given twice, as that of {self.lens_of} and as {self.lens:g} mm; give one of them"
            )
        if self.lens_of:
            camera = find_object(scene, self.lens_of)
        if camera is None:
            lens = self.lens if given else scene.mps.estimate.lens
            return {"focal": round_as_typed(lens)} if lens else {}
        check_in_scene(scene, camera, "camera of the lens")
        if camera.type != "CAMERA":
            raise InputError(f'the lens is to be that of "{camera.name}", which is no camera; name one')
        write_camera(folder / "lens.json", scene_camera(camera, scene, picture_size(photo)))
        return {"lens": str(folder / "lens.json")}

    def _place(self, context: Any, photo: Any, folder: Path) -> dict[str, Any]:
        """The core's options for the camera's approximate pose; empty to try all views."""
        if photo.mps.pairs:
            pairs = [{"pixel": list(pair.pixel), "point": list(pair.point)} for pair in photo.mps.pairs]
            (folder / "pairs.json").write_text(json.dumps({"pairs": pairs}), encoding="utf-8")
            return {"points": str(folder / "pairs.json")}
        if self.start == "SEARCH":
            return {}
        if self.start == "VIEWPORT":
            start = _viewport(context)
        else:
            camera = chosen_camera(context.scene, photo) or context.scene.camera
            if camera is None:
                raise InputError("there is no camera to start from; choose another start, or add a camera")
            start = scene_camera(camera, context.scene, picture_size(photo))
        write_camera(folder / "start.json", start)
        return {"start": str(folder / "start.json")}

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        result_is = f"its camera is in {self._camera}"
        scene, photo = self.scene(result_is), by_session_uid(bpy.data.images, self._photo)
        if photo is None:
            raise InputError(f"the photo is gone; {result_is}")
        camera = _camera_object(scene, photo, read_camera(self._camera), by_session_uid(bpy.data.objects, self._target))
        photo.mps.camera = camera
        photo.mps.poor, photo.mps.outline_pixels = result["poor"], result["outline_pixels"]
        fit = fit_in_words(result["outline_pixels"], result["normals_degrees"], result["overlap"], result["poor"])
        photo.mps.fit = f"{fit}, but the mesh seems to be mirrored" if result["mirrored"] else fit
        if not photo.mps.poor:
            self.note(fit)
        for pair, residual in zip(photo.mps.pairs, result.get("residuals") or (), strict=False):
            pair.residual = residual
        scene.mps.align.image = self.loaded(self._overlay, "MPS Alignment", is_data=False)
        self.tell(f'Camera "{camera.name}": {photo.mps.fit}', "WARNING" if photo.mps.poor else "INFO")


def mesh_of_photo(context: Any) -> Any:
    """The default mesh object of a photo; None if there is none."""
    target = target_of(context)
    return target if target is not None and target.type == "MESH" else None


def _viewport(context: Any) -> Camera:
    """The 3D viewport's view as a camera. Raises InputError if there is none."""
    view = getattr(context, "region_data", None)
    if view is None or bpy.app.background:
        raise InputError('start "VIEWPORT" needs a 3D viewport to take it from; choose "SEARCH" or "CAMERA"')
    region = next(region for region in context.area.regions if region.type == "WINDOW")  # the button is in the sidebar
    pose = Matrix.LocRotScale(view.view_matrix.inverted().translation, view.view_rotation, None)
    focal = float(np.clip(view.window_matrix[0][0] * region.width / 2, 1, 1e6))
    if not view.is_perspective:
        focal = max(region.width, region.height) * context.space_data.lens / FULL_FRAME / 2
    return Camera("perspective", region.width, region.height, np.full(2, focal), world_from_camera=np.array(pose))


def _camera_object(scene: Any, photo: Any, found: Camera, target: Any) -> Any:
    """The found camera as an object in the scene, with the photo as background image.

    That of an earlier run is moved. The scene gets the photo's resolution: otherwise its view would differ.
    """
    camera = chosen_camera(scene, photo)
    if camera is None or not camera.get(_MADE_HERE):
        camera = bpy.data.objects.new(photo.name, bpy.data.cameras.new(photo.name))
        camera[_MADE_HERE] = True
        scene.collection.objects.link(camera)
    data, longer = camera.data, max(found.width, found.height)
    data.type, data.sensor_fit, data.sensor_width = "PERSP", "AUTO", FULL_FRAME
    data.lens = found.focal_35mm
    off = found.centre - np.array([found.width, found.height]) / 2
    data.shift_x, data.shift_y = -off[0] / longer, off[1] / longer
    if target is not None:  # what moves the object moves the camera that it was seen by
        camera.parent, camera.matrix_parent_inverse = target, target.matrix_world.inverted()
        data.display_size = max(target.dimensions) / 16  # a metre may be larger than the object
    camera.matrix_world = Matrix(found.world_from_camera.tolist())
    if target is not None:
        away = (camera.matrix_world.translation - middle_of(target)).length + max(target.dimensions)
        data.clip_start, data.clip_end = away / 1000, away * 10
    data.show_background_images = True
    data.background_images.clear()
    data.background_images.new().image = photo
    scene.render.resolution_x, scene.render.resolution_y = found.width, found.height
    scene.camera = scene.camera or camera
    return camera


class MPS_OT_remove_align_point(ReportingOperator, bpy.types.Operator):
    """Remove this pair of points"""

    bl_label = "Remove Point"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    requires = "photo"

    index: IntSetting("Number", "Number of the pair in the photo's list, from 0", min=0)

    def act(self, context: Any) -> None:
        pairs = context.scene.mps.photo.image.mps.pairs
        if self.index >= len(pairs):
            raise InputError(f"there is no pair {self.index}; the photo has {len(pairs)}, numbered from 0")
        pairs.remove(self.index)
