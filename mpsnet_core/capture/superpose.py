"""Photos that show one light each become one photo: coloured lights are added up, white ones get a channel each."""

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.io.image import Image
from mpsnet_core.io.images import Encoding, read_image


def superpose(
    photos: Sequence[str | os.PathLike[str]], *, encoding: Encoding = "auto"
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """The sum of photos of a thing that did not move, and the largest alpha of them, None where none has any.

    Returns (H, W, 3) linear and (H, W). Raises InputError where there is no photo, their sizes differ or all of it is
    transparent.
    """
    images = _read(photos, encoding, grey=False)
    return np.sum([image.pixels for image in images], axis=0), _alpha(images)


def as_channels(
    photos: Sequence[str | os.PathLike[str]], *, encoding: Encoding = "auto"
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Three photos of a thing that did not move, each under one white light, as the channels of one photo.

    Returns (H, W, 3) linear, each the mean of its photo's channels, and the largest alpha (H, W), None where none has
    any. The mean is the same for all three, so that paint has one albedo under all lights. Photos of one channel are
    taken as they are. Where a photo is clipped in any channel, its value is at least 1.

    Raises InputError where there are not three photos, or as :func:`superpose` does.
    """
    if len(photos) != 3:
        raise InputError(f"{len(photos)} photo(s) where three are needed, one for each light in the rig's order")
    images = _read(photos, encoding, grey=True)
    means = [
        np.where(image.saturated.any(axis=-1), np.float32(max(1, image.pixels.max())), image.pixels.mean(axis=-1))
        for image in images
    ]
    return np.stack(means, axis=-1), _alpha(images)


def _read(photos: Sequence[str | os.PathLike[str]], encoding: Encoding, grey: bool) -> list[Image]:
    if not photos:
        raise InputError("there is no photo to superpose; give one for each light")
    images = [read_image(photo, encoding=encoding, grey=grey) for photo in photos]
    height, width, _ = images[0].pixels.shape
    for photo, image in zip(photos, images, strict=True):
        if image.pixels.shape != images[0].pixels.shape:
            found = f"{image.pixels.shape[1]} x {image.pixels.shape[0]}"
            raise InputError(f"{photo} is {found} but {photos[0]} is {width} x {height}; they must be the same size")
    return images


def _alpha(images: Sequence[Image]) -> NDArray[np.float32] | None:
    alphas = [image.alpha for image in images if image.alpha is not None]
    alpha: NDArray[np.float32] | None = np.max(alphas, axis=0) if alphas else None
    if alpha is not None and not alpha.any():
        raise InputError(
            "the photo shows nothing, all of it is transparent; show the object in renders, and let the camera see it"
        )
    return alpha
