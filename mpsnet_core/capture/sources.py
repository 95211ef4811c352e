"""Sources: photos that have not been opened yet, with all that is known about them."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.defaults import MASK
from mpsnet_core.io.image import Image
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.posed_photo import Lens
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.rig import LightRig

MESH = "mesh"  # the mask of a posed view: where its camera sees the mesh


@dataclass(frozen=True, eq=False)
class Source:
    """A photo to open: a still, a frame, a posed view or a material."""

    photo: Path | Callable[[], Image]
    """Its file, or a function that returns its pixels as read, such as those of a video's frame."""
    rig: LightRig | None
    """The lights, in camera space; None if they are unknown. There is then a mask, but no capture."""
    mask: str | os.PathLike[str] | Callable[[Image], NDArray[np.bool_]] = MASK
    """The mask as in :func:`mpsnet_core.read_capture`, :data:`MESH`, or a function that finds the mask (H, W) in the
    photo."""
    name: str = ""
    """Name of the photo in messages; its path by default."""
    camera: Camera | float | None = None
    """The camera, the focal length of its lens in mm on a sensor 36 mm wide, or None. A camera of the same aspect ratio
    is scaled to the photo's size."""
    lens: Lens | None = None
    """The distortion to remove; None if there is none."""
    depth: NDArray[np.float32] | float | None = None
    """(H, W) or a number. Distance of the surface in front of the camera, as in :func:`mpsnet_core.read_capture`."""
    scene: RayScene | None = None
    """The object's mesh in the camera's world, in place of the depth."""
    white: Sequence[str | os.PathLike[str]] = ()
    """Photos of the same pose under white light, as in :func:`mpsnet_core.read_capture`."""
    white_light: ArrayLike | None = None
    """What lit the white photos, as in :func:`mpsnet_core.read_capture`."""

    def __str__(self) -> str:
        return self.name or str(self.photo)

    @property
    def file_name(self) -> str:
        """The name of the file, or of the frame."""
        return self.photo.name if isinstance(self.photo, Path) else self.name
