"""Combine photos of one light each: add up photos of coloured lights, make photos of white lights the channels."""

import logging
import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.capture.decode import warn_of_other_exposures
from mpsnet_core.errors import NoObject, SettingsError
from mpsnet_core.io.image import Image, in_frame_of, warn_of_saturation
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_image

log = logging.getLogger(__name__)


def superpose(
    photos: Sequence[str | os.PathLike[str]], *, encoding: Encoding = "auto"
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """The sum of photos of an object that did not move, and the maximum of their alphas.

    Parameters
    ----------
    photos : sequence of str or path
        One for each coloured light.
    encoding : str
        How the photos' values are encoded: "auto", "linear" or "srgb".

    Returns
    -------
    pixels : (H, W, 3) float32
        Linear; may be above 1.
    alpha : (H, W) float32, or None
        None if no photo has alpha.

    Raises
    ------
    SettingsError
        If there is no photo.
    GeometryError
        If sizes differ, or the result is fully transparent.
    """
    images = _read(photos, encoding, grey=False)
    return np.sum([image.pixels for image in images], axis=0), _alpha(images)


def as_channels(
    photos: Sequence[str | os.PathLike[str]], *, encoding: Encoding = "auto"
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
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
    pixels : (H, W, 3) float32
        Linear. Each channel is the unweighted mean of its photo's channels: a paint has the same albedo under all three
        lights. Photos of one channel are used as they are.
    alpha : (H, W) float32, or None
        Maximum of the three; None if no photo has alpha.

    Raises
    ------
    SettingsError
        If there are not three photos.
    GeometryError
        If sizes differ, or the result is fully transparent.
    """
    if len(photos) != 3:
        raise SettingsError(f"{len(photos)} photo(s) where three are needed, one for each light in the rig's order")
    images = _read(photos, encoding, grey=True)
    means = [
        np.where(
            image.saturated.any(axis=-1), np.maximum(np.float32(1), image.pixels.max()), image.pixels.mean(axis=-1)
        )
        for image in images
    ]
    return np.stack(means, axis=-1), _alpha(images)


def _read(photos: Sequence[str | os.PathLike[str]], encoding: Encoding, grey: bool) -> list[Image]:
    if not photos:
        raise SettingsError("there is no photo to superpose; give one for each light")
    images = [read_image(photo, encoding=encoding, grey=grey) for photo in photos]
    images = [in_frame_of(image, photo, images[0], photos[0]) for photo, image in zip(photos, images, strict=True)]
    for photo, image in zip(photos, images, strict=True):
        check_same_size(str(photo), image.pixels.shape[:2], str(photos[0]), images[0].pixels.shape[:2])
        if image is not images[0] and np.array_equal(image.pixels, images[0].pixels):
            log.warning("%s shows the same as %s: was the photo of another light meant?", photo, photos[0])
    warn_of_other_exposures(photos, images)
    for photo, image in zip(photos, images, strict=True):
        warn_of_saturation(photo, image)  # the combined photo, in floats, does not show it any more
    return images


def _alpha(images: Sequence[Image]) -> NDArray[np.float32] | None:
    alphas = [image.alpha for image in images if image.alpha is not None]
    alpha: NDArray[np.float32] | None = np.max(alphas, axis=0) if alphas else None
    if alpha is not None and not alpha.any():
        raise NoObject(
            "the photo shows nothing, all of it is transparent; show the object in renders, and let the camera see it"
        )
    return alpha
