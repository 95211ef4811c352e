"""Sources: photos that have not been opened yet, with all that is known of them."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.defaults import MASK
from mpsnet_core.io.image import Image
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.lens import Lens
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.rig import LightRig

MESH = "mesh"  # the mask of a posed view: where its camera sees the mesh


@dataclass(frozen=True, eq=False)
class Source:
    """A photo to open: a still, a frame, a posed view or a material.

    Attributes
    ----------
    photo
        Its file, or a function that returns its pixels as read, such as those of a video's frame.
    rig
        The lights, in camera space; None if they are unknown: then there is a mask, but no capture.
    mask
        As in :func:`mpsnet_core.read_capture`, or :data:`MESH`, or a function that finds the mask (H, W) in the photo.
    name
        Of the photo in messages; its path by default.
    camera
        The camera, the focal length of its lens in mm on a sensor 36 mm wide, or None. A camera of the same aspect
        ratio is scaled to the photo's size.
    lens
        The distortion to remove; None if there is none.
    depth : (H, W) array or float
        Distance of the surface in front of the camera, as in :func:`mpsnet_core.read_capture`.
    scene
        The object's mesh in the world of the camera, in place of the depth.
    white, white_light
        Photos of the same pose under white light, and what lit them, as in :func:`mpsnet_core.read_capture`.
    """

    photo: Path | Callable[[], Image]
    rig: LightRig | None
    mask: str | os.PathLike[str] | Callable[[Image], NDArray[np.bool_]] = MASK
    name: str = ""
    camera: Camera | float | None = None
    lens: Lens | None = None
    depth: NDArray[np.float32] | float | None = None
    scene: RayScene | None = None
    white: Sequence[str | os.PathLike[str]] = ()
    white_light: ArrayLike | None = None

    def __str__(self) -> str:
        return self.name or str(self.photo)

    @property
    def file_name(self) -> str:
        """The name of the file, or of the frame."""
        return self.photo.name if isinstance(self.photo, Path) else self.name
