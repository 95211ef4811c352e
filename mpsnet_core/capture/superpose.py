"""Combine photos of one light each: add up photos of coloured lights, make photos of white lights the channels."""

import logging
from collections.abc import Sequence
from functools import partial

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.capture.decode import warn_of_other_exposures
from mpsnet_core.errors import NoObject, SettingsError
from mpsnet_core.io.image import Image, in_one_frame, warn_of_saturation
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)


def superpose(photos: Sequence[AnyPath], *, encoding: Encoding = "auto", grey: bool = False) -> Image:
    """The sum of photos of an object that did not move.

    Parameters
    ----------
    photos : sequence of str or path
        One for each light.
    encoding : str
        How the photos' values are encoded: "auto", "linear" or "srgb".
    grey : bool
        Whether photos of one channel are taken, too, as grey ones.

    Returns
    -------
    Image
        Linear; may be above 1. Its alpha is the maximum of the photos'; None if no photo has alpha.

    Raises
    ------
    SettingsError
        If no photo is given.
    GeometryError
        If sizes differ, or the result is fully transparent.
    """
    return added_up(read_shots(photos, encoding, grey=grey))


def added_up(images: Sequence[Image]) -> Image:
    """The sum of images, as :func:`superpose` makes it."""
    coloured = [np.broadcast_to(image.pixels, (*image.pixels.shape[:2], 3)) for image in images]
    return _together(images, np.sum(coloured, axis=0))


def as_channels(photos: Sequence[AnyPath], *, encoding: Encoding = "auto") -> Image:
    """Three photos of an object that did not move, each under one white light, as the channels of one photo.

    Pixels of a photo that are clipped in any channel become at least 1.

    Parameters
    ----------
    photos : sequence of str or path
        In the rig's order.
    encoding : str
        How the photos' values are encoded: "auto", "linear" or "srgb".

    Returns
    -------
    Image
        Linear. Each channel is the unweighted mean of its photo's channels: a paint has the same albedo under all three
        lights. Photos of one channel are used as they are. Alpha as in :func:`superpose`.

    Raises
    ------
    SettingsError
        If there are not three photos.
    GeometryError
        If sizes differ, or the result is fully transparent.
    """
    return stacked(read_shots(photos, encoding, grey=True))


def stacked(images: Sequence[Image]) -> Image:
    """The channels of one photo, as :func:`as_channels` makes them of three images."""
    if len(images) != 3:
        raise SettingsError(f"{len(images)} photo(s) where three are needed, one for each light in the rig's order")
    means = []
    for image in images:
        clipped, full = image.saturated.any(axis=-1), np.maximum(np.float32(1), image.pixels.max())
        means.append(np.where(clipped, full, image.pixels.mean(axis=-1)))
    return _together(images, np.stack(means, axis=-1))


def read_shots(photos: Sequence[AnyPath], encoding: Encoding, *, grey: bool) -> list[Image]:
    """Photos of an object that did not move, one for each light, with warnings of what is wrong with them.

    grey: see :func:`superpose`. Raises SettingsError if no photo is given, GeometryError if sizes differ.
    """
    if not photos:
        raise SettingsError("there is no photo to superpose; give one for each light")
    images = [*in_one_frame(photos, partial(read_image, encoding=encoding, grey=grey))]
    for photo, image in zip(photos, images, strict=True):
        if image is not images[0] and np.array_equal(image.pixels, images[0].pixels):
            log.warning("%s shows the same as %s: was the photo of another light meant?", photo, photos[0])
        warn_of_saturation(photo, image)  # the combined photo, in floats, does not show it any more
    warn_of_other_exposures(photos, images)
    return images


def _together(images: Sequence[Image], pixels: F32) -> Image:
    """A photo made of others. What they do not state of their encoding, it does not state either."""
    alphas = [image.alpha for image in images if image.alpha is not None]
    alpha: F32 | None = np.max(alphas, axis=0) if alphas else None
    if alpha is not None and not alpha.any():
        raise NoObject("the photo is completely transparent; make the object visible in renders and to the camera")
    assumed = images[0].assumed if len({image.assumed for image in images}) == 1 else None
    return Image(pixels, alpha, np.inf, assumed=assumed)
