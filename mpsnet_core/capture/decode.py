"""From files to linear pixels: how to read photos and their companions, all of them alike."""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.capture.correction import Correction
from mpsnet_core.io.image import Assumed, Image, exposed_otherwise, in_frame_of
from mpsnet_core.io.image_encoding import Encoding, otherwise_encoded
from mpsnet_core.io.image_reading import layer_in, read_image
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.posed_photo import Lens, undistorted, undistorted_mask

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PhotoReadOptions:
    """How to read a photo and its companions: the photo of the background and the one under white light."""

    encoding: Encoding = "auto"
    """How the values encode light, as in :func:`mpsnet_core.read_image`."""
    layer: str | None = None
    """Layer of a file with several, as in :func:`mpsnet_core.read_image`."""
    correction: Correction | None = None
    """Dark frame and flat field; None if there is neither."""
    assumed: Assumed | None = None
    """The encoding of files that do not state it. By default the usual one: sRGB for integers, linear for floats."""

    def photo(self, path: str | os.PathLike[str], *, grey: bool = False) -> Image:
        """Read a photo, without correction. grey and errors: as in :func:`read_image`.

        A large photo is held in half floats, unless it will be corrected.
        """
        compact = self.correction is None
        return self._meant(read_image(path, encoding=self.encoding, layer=self.layer, grey=grey, compact=compact))

    def companion(self, path: str | os.PathLike[str], photo: Image) -> Image:
        """Read a companion of the photo, without correction, from the photo's layer if the file has several.

        It is turned as the photo was: the camera stood still.
        """
        image = self._meant(read_image(path, encoding=self.encoding, layer=layer_in(path, self.layer)))
        return in_frame_of(image, path, photo, "the photo")

    def _meant(self, image: Image) -> Image:
        other = image.assumed and self.assumed not in (None, image.assumed)
        return otherwise_encoded(image) if other else image


AS_STATED: PhotoReadOptions = PhotoReadOptions()  # the encoding that the files state


def undistorted_photo(image: Image, camera: Camera, lens: Lens | None) -> Image:
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
            times = photo, image.exposure_time, photos[0], first
            log.warning("%s was exposed for %.3g s, %s for %.3g s: use the same for all lights", *times)
