"""How photos are read: what their values mean, which layer counts, and what camera and lights add to every photo."""

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
    """How a photo is read, and what goes with it: its background, its photo under white light.

    The fields are keywords of :func:`find_mask` and :func:`read_capture`.

    Attributes
    ----------
    encoding, layer
        As in :func:`read_image`.
    correction
        Dark frame and flat field; None where there is neither.
    """

    encoding: Encoding = "auto"
    layer: str | None = None
    correction: Correction | None = None

    def photo(self, path: str | os.PathLike[str], *, compact: bool = False) -> Image:
        """The photo, not corrected yet. compact: as in :func:`read_image`, which says what is raised."""
        return read_image(path, encoding=self.encoding, layer=self.layer, compact=compact)

    def companion(self, path: str | os.PathLike[str]) -> Image:
        """What belongs to the photo, not corrected yet: by the photo's layer where that file has several."""
        return read_image(path, encoding=self.encoding, layer=layer_in(path, self.layer))


AS_STATED = Reading()  # as the files themselves state it


def note_other_exposures(photos: Sequence[str | os.PathLike[str]], images: Sequence[Image]) -> None:
    """Report photos of one light each that, by their files, were not exposed as long as the first."""
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
