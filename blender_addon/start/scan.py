"""Scan: from a photo and a mesh of the object to the texture, step by step, without a rig and a calibration."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from mpsnet_core.calibrate.operations import POOR
from mpsnet_core.capture.colourfulness import colourfulness
from mpsnet_core.errors import InputError, Note
from mpsnet_core.io.files import PHOTO_SUFFIXES

from ..bake.bake_operator import check_shows_normals
from ..bake.before_after import draw_results
from ..bake.unwrap import lacks_uvs, unwrap
from ..images import pixels_of
from ..operators.chain import Call, RunsSteps, run_operator
from ..operators.core_run import idle
from ..photo.align import mesh_of_photo
from ..photo.camera import chosen_camera, lacks_photo_camera
from ..photo.options import finds_lights, rig_file_for
from ..photo.photo import LIGHTS, load_any_photo
from ..scene.objects import find_object, select
from ..scene.surfaces import middle_of
from ..settings.declared import FileSetting, StringSetting
from ..settings.record import result_of
from .try_it import look_at

# Two pictures of which the more colourful one is not so by this factor cannot be told apart.
_CLEARLY = 1.1

# From how far the result is shown, at most: as a multiple of the target's largest dimension, and of the distance of the
# photo's camera, which would be drawn over it.
_AWAY, _BEFORE_CAMERA = 2.0, 0.85


class MPS_OT_scan(RunsSteps, bpy.types.Operator):
    """Make a texture of the photo on the target's mesh: find the camera and the lights, unwrap, estimate and bake.

    What is known already is kept. Each result is shown in its own step. It stops where it is unsure, and says why"""

    bl_idname = "mps.scan"
    bl_label = "Scan"
    drawn = staticmethod(draw_results)
    first_message = Note("looking at the mesh")

    photo: FileSetting("Photo", "Photo of the object to open first. Empty: the one that is open")
    white: FileSetting("White Photo", "The same pose under white light, which shows the colours. Empty: the panel's")
    target: StringSetting("Target", "Name of the mesh object in the photo. Empty: the target, else the active one")

    # Filled by Blender where files were dropped.
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def lacks(cls, context: Any) -> str:
        if context.scene.mps.photo.image is None:
            return "Open a photo of the object first"
        return "" if mesh_of_photo(context) else "Select the mesh object that the photo shows"

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context)  # a script may give the photo and the target

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if self.files and (mesh := mesh_under(context, event.mouse_x, event.mouse_y) or _active_mesh(context)):
            self.target = mesh.name
        return super().invoke(context, event)

    def steps(self) -> Sequence[Callable[[Any], Call | None]]:
        return self._shots, self._prepare, self._align, self._lights, self._estimate, self._bake, self._present

    def _shots(self, context: Any) -> Call | None:
        pictures = sorted(Path(self.directory, file.name) for file in self.files)
        if len(pictures) == len(LIGHTS):
            return "superpose", dict(zip(LIGHTS, map(str, pictures), strict=True))
        if pictures:
            self.photo, self.white = photo_and_white(pictures)
        return None

    def _prepare(self, context: Any) -> None:
        scene = context.scene
        if self.photo:
            run_operator(bpy.ops.mps.open_photo, filepath=self.photo)
        if self.white:
            scene.mps.estimate.white = self.white
            words = Note("%s is taken as the white photo: it is the less colourful one", Path(self.white).name)
            if self.files:
                self._store_record(notes=[words])
                self.tell(str(words))
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
            select(context.view_layer, [target], target)
            camera = chosen_camera(scene, scene.mps.photo.image)
            if camera is not None:  # the side that the photo shows
                middle, pose = middle_of(target), camera.matrix_world
                distance = (pose.translation - middle).length
                away = min(_AWAY * max(target.dimensions), _BEFORE_CAMERA * distance)
                look_at(context, middle, away, pose.to_quaternion())
            if scene.mps.relight.lamp is None:
                run_operator(bpy.ops.mps.relight)
        self.tell("The object shows the photo's normals. Before / After in 4 Bake compares; Relight stops the lamp")


class MPS_FH_scan(bpy.types.FileHandler):
    """Drag and drop onto a mesh in a 3D viewport: a photo, a photo and its white photo, or three of one light each."""

    bl_idname = "MPS_FH_scan"
    bl_label = "Scan onto the Mesh with MPS-Net"
    bl_import_operator = "mps.scan"
    bl_file_extensions = ";".join(PHOTO_SUFFIXES)

    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        in_viewport = context.area is not None and context.area.type == "VIEW_3D"
        return in_viewport and any(obj.type == "MESH" for obj in context.view_layer.objects)


def photo_and_white(pictures: Sequence[Path]) -> tuple[str, str]:
    """Which of dropped pictures is the photo, and which the white photo; "" if there is none.

    Raises InputError if there are more than two, or two that cannot be told apart.
    """
    if len(pictures) > 2:
        raise InputError(
            f"these are {len(pictures)} pictures; drop one photo, a photo and its white photo, or three under one "
            "white light each"
        )
    if len(pictures) < 2:
        return str(pictures[0]), ""
    before, colours = set(bpy.data.images), []
    for picture in pictures:
        image = load_any_photo(picture)
        colours.append((colourfulness(pixels_of(image)[..., :3]), picture))
        if image not in before:
            bpy.data.images.remove(image)
    (less, white), (more, photo) = sorted(colours)
    if more < _CLEARLY * less:
        raise InputError(
            f"{photo.name} and {white.name} are equally colourful, so it is not clear which is the white "
            "photo; drop the photo alone, and choose the white photo in Photo > Colour"
        )
    return str(photo), str(white)


def mesh_under(context: Any, x: float, y: float) -> Any:
    """The visible mesh object under the mouse in a viewport, None if there is none. x, y: in the window's pixels."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return None
    region = next(region for region in area.regions if region.type == "WINDOW")
    place, view = (x - region.x, y - region.y), area.spaces.active.region_3d
    start, way = (of(region, view, place) for of in (region_2d_to_origin_3d, region_2d_to_vector_3d))
    hit, *_, obj, _ = context.scene.ray_cast(context.evaluated_depsgraph_get(), start, way)
    return obj if hit and obj.type == "MESH" else None


def _active_mesh(context: Any) -> Any:
    active = context.view_layer.objects.active
    return active if active is not None and active.type == "MESH" else None
