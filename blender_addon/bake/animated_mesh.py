"""Mesh and camera of each frame of the timeline, for textures that follow an animation.

Frames are read in slices. Between two slices, the window shows its own frame again, and users may change anything in
the file.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import write_camera

from ..scene.camera import scene_camera
from ..scene.mesh_file import BegunMesh, Slices, begin_mesh
from ..scene.objects import by_session_uid, view_layer

MESHES, CAMERAS = "mesh_######.npz", "camera_######.json"


@dataclass(frozen=True)
class AnimatedMesh:
    """What to write for each frame."""

    folder: Path
    """For the files."""
    scene: int
    """Its session UID."""
    target: int
    """Session UID of the object."""
    uv_map: str
    """See :func:`.mesh_file.begin_mesh`."""
    camera: int = 0
    """Session UID of the camera to write, 0 for none."""
    size: tuple[int, int] = (0, 0)
    """Width and height of the camera's image in pixels."""

    def begin(self, frames: range) -> BegunMesh:
        """Read the first frame with :func:`.mesh_file.begin_mesh`, and raise as it does. The slices read the others."""
        first = self._begin_frame(frames[0])
        return replace(first, slices=self._slices(first.slices, frames[1:]))

    def _slices(self, first: Slices, others: range) -> Slices:
        yield from first
        for number in others:
            yield True  # Blender evaluates the scene without interruption
            yield from self._begin_frame(number).slices

    def _begin_frame(self, number: int) -> BegunMesh:
        scene, target = by_session_uid(bpy.data.scenes, self.scene), by_session_uid(bpy.data.objects, self.target)
        camera = by_session_uid(bpy.data.objects, self.camera) if self.camera else None
        if scene is None or target is None or (self.camera and camera is None):
            gone = "scene" if scene is None else "target" if target is None else "camera"
            raise InputError(f"the {gone} was deleted before all frames were read; undo that, and bake again")
        before = scene.frame_current, scene.frame_subframe
        with bpy.context.temp_override(scene=scene, view_layer=view_layer(scene)):
            scene.frame_set(number)
            try:
                mesh = self.folder / MESHES.replace("######", f"{number:06d}")
                begun = begin_mesh(mesh, target, bpy.context.evaluated_depsgraph_get(), self.uv_map)
                if camera is not None:
                    file = self.folder / CAMERAS.replace("######", f"{number:06d}")
                    write_camera(file, scene_camera(camera, scene, self.size))
            finally:
                scene.frame_set(before[0], subframe=before[1])
        return begun
