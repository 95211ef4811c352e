"""The bake: the camera's normals become a texture on the target's UVs, which its material gets."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.bake.operations import Bake
from mpsnet_core.errors import GeometryError, InputError, Note, SettingsError
from mpsnet_core.scene.camera import read_camera, write_camera

from ..image_records import Provenance, chosen, remembered, stamp
from ..images import frame_pattern, image_file, picture_size
from ..outputs import FORMATS, output_frames
from ..photo.camera import (
    back_to_photo,
    camera_beside,
    camera_provenance,
    chosen_camera,
    lacks_camera,
    write_photo_camera,
)
from ..rig.rig import rig_camera
from ..scene.camera import scene_camera
from ..scene.mesh_file import BegunMesh, Slices, begin_mesh
from ..scene.objects import by_session_uid, view_layer
from ..settings.bake import BakeSettings
from .bake_operator import BakeOperator, bake_target, known_target, target_provenance, texture_name
from .texture_sets import FRAME

POOR_FIT = Note("the mesh fits the photo poorly; look at Align Photo, in Camera", level="stop")
NO_CAMERA = "Where was the photo taken from? Press Align Photo in the step Photo, or choose the camera there"
MESHES, CAMERAS = "mesh_######.npz", "camera_######.json"


class MPS_OT_bake(BakeOperator, BakeSettings, bpy.types.Operator):
    """Bake the estimated normals into a texture on the target's UV map and give its material a Normal Map node"""

    bl_label = "Bake Texture"
    step = "bake"

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene = context.scene
        if scene.mps.estimate.image is None:
            return "Estimate the normals first"
        return NO_CAMERA if lacks_camera(scene, scene.mps.estimate.image) else ""

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        settings, image = context.scene.mps.bake, context.scene.mps.estimate.image
        target = None if image is not None and image.source == "SEQUENCE" else known_target(settings)
        every = context.scene.mps.every_rig if settings.all_rigs else [context.scene.mps]
        images = [one.estimate.image for one in every]
        known = [one for one in images if one is not None] or [image]
        places = [camera_provenance(context.scene, one, target) for one in known]
        return {
            "Normals": ", ".join(map(stamp, images)),
            **chosen(settings, without=("output", "assign", "mark_asset")),
            **target_provenance(settings),
            **{name: ", ".join(one[name] for one in places if name in one) for name in dict.fromkeys(chain(*places))},
        }

    def prepare(self, context: Any, folder: Path) -> tuple[Bake, Sequence[Path]]:
        scene = context.scene
        normals_image = scene.mps.estimate.image
        normals = image_file(normals_image, "normal map", "estimate the normals first")
        self._frames = range(0)
        if normals_image.source == "SEQUENCE":
            target = self._target_of_frames(context)
            estimate = scene.mps.estimate
            self._frames = range(estimate.first_frame, estimate.last_frame + 1)
            normals = frame_pattern(normals)
            self._output = output_frames(self.output, texture_name(self, target.name))
            suffix = f".{FORMATS[self.file_format]}"
            targets = [target]
            mesh, camera = self._write_place(context, folder, target, normals_image)
            meshes: tuple[str, ...] = (mesh,)
        else:
            targets = self.baked_objects(context)
            self._output = self.texture_file(context, targets)
            suffix = self._output.suffix.lower()
            meshes = self.write_meshes(context, folder, targets, partial(back_to_photo, normals_image))
            camera = str(folder / "camera.json")
            self._write_camera(scene, folder / "camera.json", normals_image)
        photo = normals_image.mps.photo
        if photo is not None and photo.mps.poor and chosen_camera(scene, normals_image) is not None:
            self._notes = [*self._notes, POOR_FIT]
        others = self._other_rigs(scene) if self.all_rigs else []
        albedos = self._albedos([scene.mps, *others])
        self._coloured = bool(albedos)
        operation = Bake(
            mesh=meshes,
            view=(f"{camera}={normals}", *self._other_views(scene, others, folder, targets)),
            albedo=albedos,
            **self.texture_options(Bake, self, targets, folder),
            format=suffix[1:] if self._frames else None,
        )
        return operation, [self._output / "frames" if self._frames else self._output]

    def result_owners(self) -> dict[Path, list[Any]]:
        if not self._frames:
            return super().result_owners()
        frames = self._output / f"{self._output.name}_{FRAME}.{FORMATS[self.file_format]}"
        return {frames: [by_session_uid(bpy.data.objects, self._bake_targets[0].uid)]}

    def _target_of_frames(self, context: Any) -> Any:
        if self.objects == "SELECTED" or self.split != "ONE" or self.tiles:
            raise SettingsError(
                "a sequence is baked onto the target alone and into one texture per frame; set Objects to "
                "Target, Textures to One for All, and switch UDIM Tiles off"
            )
        return self.baked_object(context)

    def _write_camera(self, scene: Any, path: Path, normals_image: Any) -> None:
        """Write the camera of the photo that the normals are from, or the rig's current one."""
        if not write_photo_camera(path, scene, normals_image):
            write_photo_camera(path, scene, normals_image, rig_camera(scene))

    def _write_place(self, context: Any, folder: Path, target: Any, normals_image: Any) -> tuple[str, str]:
        """Write mesh and camera for a sequence: once, or for each frame if they are animated."""
        scene, camera = context.scene, "camera.json"
        if not self.animated:
            begun = self.write_mesh(context, folder / "mesh.npz", target, self.uv_map)
        else:
            seen_by = chosen_camera(scene, normals_image)
            if seen_by is None and remembered(normals_image, "camera") is None:
                seen_by = rig_camera(scene)
            if seen_by is not None:
                camera = CAMERAS
            size = picture_size(normals_image)
            begun = begin_frames(folder, self._frames, self.uv_map, scene, target, seen_by, size)
            self.schedule(begun.slices)
        self._bake_targets = [bake_target(target, begun)]
        if camera != CAMERAS:
            self._write_camera(scene, folder / camera, normals_image)
        return str(folder / (MESHES if self.animated else "mesh.npz")), str(folder / camera)

    def _other_rigs(self, scene: Any) -> list[Any]:
        """The scene's other rigs that have normals. A note names those without."""
        if self._frames:
            raise SettingsError("sequences are baked for one rig at a time; switch All Rigs off")
        others = [one for one in scene.mps.every_rig if one != scene.mps.chosen]
        without = ", ".join(f'"{one.name}"' for one in others if one.estimate.image is None)
        if without:
            self._notes = [*self._notes, Note("Rigs without normals are left out: %s", without, level="look")]
        others = [one for one in others if one.estimate.image is not None]
        if any(one.estimate.image.source == "SEQUENCE" for one in others):
            raise SettingsError("one of the rigs has a sequence, which is baked on its own; switch All Rigs off")
        return others

    def _other_views(self, scene: Any, rigs: Sequence[Any], folder: Path, targets: Sequence[Any]) -> list[str]:
        """The normals and cameras of other rigs as options of the core, with the targets as the chosen rig saw them."""
        chosen_image = scene.mps.estimate.image
        views = []
        for number, one in enumerate(rigs):
            image = one.estimate.image
            camera = folder / f"camera_{number}.json"
            if lacks_camera(scene, image):
                raise GeometryError(
                    f'nobody knows the camera of the normals "{image.name}"; choose their rig and press Align Photo'
                )
            if not write_photo_camera(camera, scene, image, one.rig.camera):
                raise GeometryError(f'the camera of the normals "{image.name}" is gone; estimate them again')
            write_camera(camera, camera_beside(read_camera(camera), image, chosen_image, targets))
            views.append(f"{camera}={image_file(image, 'normal map', 'estimate the normals again')}")
        return views

    def _albedos(self, rigs: Sequence[Any]) -> tuple[str, ...]:
        """The albedos of the rigs' photos, if all of them have one."""
        images = [one.estimate.albedo_image for one in rigs]
        if self._frames or None in images:
            return ()
        return tuple(str(image_file(image, "albedo", "estimate the normals again")) for image in images)

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its texture is in {self._output}")
        self.assign_result(scene, result)
        self.tell(self.written(result))


def begin_frames(
    folder: Path,
    frames: range,
    uv_map: str,
    scene: Any,
    target: Any,
    camera: Any = None,
    size: tuple[int, int] = (0, 0),
) -> BegunMesh:
    """Read the mesh of the first frame, and the camera if there is one; the slices read the other frames.

    Between two slices, the window shows its own frame again, and users may change anything in the file. uv_map: as for
    :func:`.begin_mesh`, which raises likewise. size: width and height of the camera's image in pixels.
    """
    every = {"scene": ("scenes", scene), "target": ("objects", target), "camera": ("objects", camera)}
    uids = {what: (kind, one.session_uid) for what, (kind, one) in every.items() if one is not None}

    def begin(number: int) -> BegunMesh:
        found = {what: by_session_uid(getattr(bpy.data, kind), uid) for what, (kind, uid) in uids.items()}
        for gone in (what for what, one in found.items() if one is None):
            raise InputError(f"the {gone} was deleted before all frames were read; undo that, and bake again")
        scene = found["scene"]
        before = scene.frame_current, scene.frame_subframe
        with bpy.context.temp_override(scene=scene, view_layer=view_layer(scene)):
            scene.frame_set(number)
            try:
                mesh = folder / MESHES.replace("######", f"{number:06d}")
                begun = begin_mesh(mesh, found["target"], bpy.context.evaluated_depsgraph_get(), uv_map)
                if "camera" in found:
                    file = folder / CAMERAS.replace("######", f"{number:06d}")
                    write_camera(file, scene_camera(found["camera"], scene, size))
            finally:
                scene.frame_set(before[0], subframe=before[1])
        return begun

    def slices() -> Slices:
        yield from first.slices
        for number in frames[1:]:
            yield True  # Blender evaluates the scene without interruption
            yield from begin(number).slices

    first = begin(frames[0])
    return replace(first, slices=slices())
