"""How to read photos: their encoding and layer, and the correction by dark frame and flat field."""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass

from mpsnet_core.capture.correction import Correction
from mpsnet_core.io.image import Image, exposed_otherwise
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_layers import layer_in
from mpsnet_core.io.image_reading import read_image

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Reading:
    """How to read a photo and its companions: the photo of the background and the one under white light.

    The fields are keyword arguments of :func:`find_mask` and :func:`read_capture`.

    Attributes
    ----------
    encoding, layer
        As in :func:`read_image`.
    correction
        Dark frame and flat field; None if there is neither.
    """

    encoding: Encoding = "auto"
    layer: str | None = None
    correction: Correction | None = None

    def photo(self, path: str | os.PathLike[str], *, compact: bool = False) -> Image:
        """Read the photo, without correction. compact and errors: as in :func:`read_image`."""
        return read_image(path, encoding=self.encoding, layer=self.layer, compact=compact)

    def companion(self, path: str | os.PathLike[str]) -> Image:
        """Read a companion of the photo, without correction, from the photo's layer if the file has several."""
        return read_image(path, encoding=self.encoding, layer=layer_in(path, self.layer))


AS_STATED = Reading()  # the encoding that the files state


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
