"""Light adds up: photos that show one light each become the photo that shows them all."""

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.images import Encoding, read_image


def superpose(
    photos: Sequence[str | os.PathLike[str]], *, encoding: Encoding = "auto"
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """The sum of photos of a thing that did not move, and the largest alpha of them, None where none has any.

    Returns (H, W, 3) linear and (H, W). Raises InputError where there is no photo, their sizes differ or all of it is
    transparent.
    """
    if not photos:
        raise InputError("there is no photo to superpose; give one for each light")
    images = [read_image(photo, encoding=encoding) for photo in photos]
    height, width, _ = images[0].pixels.shape
    for photo, image in zip(photos, images, strict=True):
        if image.pixels.shape != images[0].pixels.shape:
            found = f"{image.pixels.shape[1]} x {image.pixels.shape[0]}"
            raise InputError(f"{photo} is {found} but {photos[0]} is {width} x {height}; they must be the same size")
    alphas = [image.alpha for image in images if image.alpha is not None]
    alpha = np.max(alphas, axis=0) if alphas else None
    if alpha is not None and not alpha.any():
        raise InputError(
            "the photo shows nothing, all of it is transparent; show the object in renders, and let the camera see it"
        )
    return np.sum([image.pixels for image in images], axis=0), alpha
