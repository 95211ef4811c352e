"""Many views: a photo for each camera, from photogrammetry or this scene, baked into one texture."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from mpsnet_core.bake.operations import BakeViews
from mpsnet_core.errors import InputError, SettingsError
from mpsnet_core.scene.rig import in_world, write_rig, write_world_lights
from mpsnet_core.scene.view_files import write_views

from ..image_records import Provenance, chosen, file_stamp, origin, remembered, rounded, stamp
from ..images import image_file
from ..openimageio import load_openimageio
from ..outputs import file_name, requested_path, unique_name
from ..photo.camera import chosen_camera, lens_stamp
from ..photo.options import network, reading
from ..rig.rig import light_rig, lights_provenance, rig_camera
from ..scene.camera import scene_camera
from ..settings.bake import ViewsSettings
from ..settings.declared import options_of
from .bake_operator import BakeOperator, known_target, target_provenance
from .texture_sets import without_tokens

# The rotation that Blender's OBJ and glTF importers apply to files with y up.
_BLENDER_FROM_Y_UP = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))


class MPS_OT_bake_views(BakeOperator, ViewsSettings, bpy.types.Operator):
    """Estimate a photo for each camera, bring all into line with the mesh and bake them into one texture.

    Size, space, convention, margin, format, file, strength and what it goes on top of are those of the step Bake, the
    model is that of Estimate"""

    bl_label = "Bake Views"
    step = "views"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        scene = context.scene.mps
        photo = ("rig_file", "encoding", "dark", "flat", "mask", "mask_file", "background", "threshold")
        shared = ("model", "model_file", *photo)
        # Settings of the step Bake for a single photo, and those that do not affect the texture.
        others = ("output", "assign", "mark_asset", "level", "level_scale", "agreed", "animated", "all_rigs")
        stand = {} if scene.estimate.rig_file else lights_provenance(context.scene)
        behind = [] if scene.views.cameras else _with_photos(context.scene)
        return {
            "Background images": ", ".join(stamp(image) for _, image in behind),
            "Cameras' places": ", ".join(f"{rounded(obj.matrix_world, 4)} {lens_stamp(obj)}" for obj, _ in behind),
            **target_provenance(scene.bake),
            **({"Target's place": rounded(target.matrix_world, 4)} if (target := known_target(scene.bake)) else {}),
            **chosen(scene.views, without=("keep", "write_report")),
            **chosen(scene.estimate, only=shared),
            **chosen(scene.bake, without=others),
            "Cameras": file_stamp(scene.views.cameras),
            "Rig File": file_stamp(scene.estimate.rig_file),
            **{f"{name} of the rig": text for name, text in stand.items()},  # "Lights" is a setting of this step
        }

    def prepare(self, context: Any, folder: Path) -> tuple[BakeViews, Sequence[Path]]:
        scene = context.scene
        bake, estimate = scene.mps.bake, scene.mps.estimate
        targets = self.baked_objects(context)
        self._output = output = self.texture_file(context, targets)
        turn = _BLENDER_FROM_Y_UP if self.cameras and self.axes == "Y_UP" else Matrix.Identity(4)
        meshes = self.write_meshes(context, folder, targets, lambda _: turn.inverted())
        outputs, self._report = [output], ""
        if self.write_report:
            outputs.append(output.with_name(f"{without_tokens(output.stem) or 'textures'}_report.html"))
            self._report = str(outputs[1])
        cameras, photos = self._cameras(scene, folder)
        self._coloured = bool(self.white)
        operation = BakeViews(
            mesh=meshes,
            cameras=cameras,
            photos=photos,
            rig=self._rig(scene, folder, turn.inverted()),
            **options_of(BakeViews, self, without=("cameras", "photos", "keep")),
            **reading(estimate, unmasked="mesh"),
            **network(estimate),
            **self.texture_options(BakeViews, bake, targets, folder),
            keep=str(requested_path(self.keep)) if self.keep else None,
            report=self._report or None,
        )
        return operation, outputs

    def _cameras(self, scene: Any, folder: Path) -> tuple[str, str | None]:
        """The file of the cameras, and the folder of their photos if the file does not list them."""
        if self.cameras:
            if not self.photos:
                raise SettingsError("where are the photos of these cameras? Choose their folder")
            return bpy.path.abspath(self.cameras), bpy.path.abspath(self.photos)
        load_openimageio()  # not needed at Blender's start
        from mpsnet_core.scene.photogrammetry.posed_photo import Lens, PosedPhoto, as_displayed

        views, found = [], _with_photos(scene)
        names = [obj.name for obj, _ in found]
        for number, (obj, image) in enumerate(found):
            photo = image_file(image, f"background image of {obj.name}", "choose another")
            posed = PosedPhoto(str(photo), scene_camera(obj, scene, tuple(image.size)), Lens())
            if remembered(image, "source") is None:  # Blender ignores the EXIF orientation
                posed = as_displayed(posed, photo)
            views.append((file_name(unique_name(names, number)), photo, posed.camera))
        if not views:
            raise InputError(
                "no camera of this scene has a background image; give each its photo in its Object Data, or choose the "
                "cameras that a photogrammetry program wrote"
            )
        write_views(folder / "views.json", views)
        return str(folder / "views.json"), None

    def _rig(self, scene: Any, folder: Path, turn: Matrix) -> str:
        """The measured rig file, or the scene's lights. turn: rotation from Blender's world to the cameras' world."""
        given = scene.mps.estimate.rig_file
        if given:
            return bpy.path.abspath(given)
        rig = light_rig(scene)
        if self.lights_in == "WORLD":
            camera = scene_camera(rig_camera(scene), scene)
            camera = replace(camera, world_from_camera=np.array(turn) @ camera.world_from_camera)
            write_world_lights(folder / "rig.json", in_world(rig, camera))
        else:
            write_rig(folder / "rig.json", rig)
        return str(folder / "rig.json")

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its texture is in {self._output}")
        scene.mps.views.report_file = self._report
        self.assign_result(scene, result)
        self.tell(f"{len(result['views'])} views baked. {self.written(result)}")


def _with_photos(scene: Any) -> list[tuple[Any, Any]]:
    """The scene's cameras with a background photo, and these photos, each once: with the camera that took it."""
    found = [(obj, image) for obj in scene.objects if (image := background(obj)) is not None]
    taker = {origin(image): obj for obj, image in reversed(found)}
    taker.update({origin(image): obj for obj, image in found if chosen_camera(scene, image) == obj})
    return [(obj, image) for obj, image in found if taker[origin(image)] == obj]


def background(obj: Any) -> Any:
    """A camera's background photo, None if there is none."""
    if obj.type != "CAMERA":
        return None
    shown = [
        behind.image
        for behind in obj.data.background_images
        if behind.source == "IMAGE" and behind.image and behind.show_background_image
    ]
    return shown[0] if shown else None
