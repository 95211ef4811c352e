"""From files to linear pixels: how to read photos and their companions, all of them alike."""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.capture.correction import Correction
from mpsnet_core.io.image import Image, exposed_otherwise
from mpsnet_core.io.image_encoding import Encoding, with_stored_values
from mpsnet_core.io.image_layers import layer_in
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.lens import Lens, undistorted, undistorted_mask

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PhotoReadOptions:
    """How to read a photo and its companions: the photo of the background and the one under white light.

    Attributes
    ----------
    encoding, layer
        As in :func:`read_image`.
    correction
        Dark frame and flat field; None if there is neither.
    linear
        Whether files that do not state their encoding are linear; sRGB by default, as most are.
    """

    encoding: Encoding = "auto"
    layer: str | None = None
    correction: Correction | None = None
    linear: bool = False

    def photo(self, path: str | os.PathLike[str], *, grey: bool = False) -> Image:
        """Read a photo, without correction. grey and errors: as in :func:`read_image`.

        A large photo is held in half floats, unless it will be corrected.
        """
        compact = self.correction is None
        return self._meant(read_image(path, encoding=self.encoding, layer=self.layer, grey=grey, compact=compact))

    def companion(self, path: str | os.PathLike[str], *, grey: bool = False) -> Image:
        """Read a companion of the photo, without correction, from the photo's layer if the file has several."""
        return self._meant(read_image(path, encoding=self.encoding, layer=layer_in(path, self.layer), grey=grey))

    def _meant(self, image: Image) -> Image:
        return with_stored_values(image) if self.linear and image.assumed else image


AS_STATED = PhotoReadOptions()  # the encoding that the files state


def straightened(image: Image, camera: Camera, lens: Lens | None) -> Image:
    """An image of the camera's size without lens distortion."""
    if lens is None:
        return image
    pixels = undistorted(image.pixels, camera, lens)
    clip, clipped = image.clip, image.clipped
    if clipped is not None or np.isfinite(clip):
        # Resampled pixels that a clipped one contributed to are wrong, although they are below the clipping value.
        whole = undistorted_mask(~np.any(image.saturated, axis=-1), camera, lens)
        clip, clipped = np.inf, np.broadcast_to(~whole[..., None], pixels.shape)
    return replace(image, pixels=pixels, alpha=None, clip=clip, clipped=clipped)


def warn_of_other_exposures(photos: Sequence[str | os.PathLike[str]], images: Sequence[Image]) -> None:
    """Report photos of one light each whose exposure time, by their files, differs from the first one's."""
    first = images[0].exposure_time
    for photo, image in zip(photos, images, strict=True):
        if exposed_otherwise(image.exposure_time, first):
            log.warning(
                "%s was exposed for %.3g s, %s for %.3g s: use the same for all lights",
                photo,
                image.exposure_time,
                photos[0],
                first,
            )
