"""The camera that a photo was taken with, as a file for the core."""

from pathlib import Path
from typing import Any

from mpsnet_core.scene.camera import write_camera

from ..outputs import picture_size, remembered
from .rig import rig_camera, scene_camera


def write_photo_camera(path: Path, image: Any, scene: Any, camera: Any = None) -> None:
    """Write the camera that is stored with a photo or its normals; without one `camera`, or the rig's, as it stands.

    Raises InputError where there is none.
    """
    taken_with = remembered(image, "camera")
    if taken_with is not None:
        path.write_text(taken_with, encoding="utf-8")
    else:
        write_camera(path, scene_camera(camera or rig_camera(scene), scene, picture_size(image)))
