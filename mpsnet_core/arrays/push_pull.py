"""What is known in parts of a picture, carried on over the rest, so that whoever interpolates across meets no step."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.upsample import upsampled


def push_pull(values: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Values (H, W) or (H, W, C) as they are where they are known, (H, W) bool, and going on smoothly elsewhere.

    Each halving of the picture takes the mean of those of four pixels that are known; what is missing then comes from
    the coarser picture, linear between its pixels: pull and push of Gortler et al., "The Lumigraph" (SIGGRAPH 1996),
    with full weight for a pixel that holds anything. Where nothing at all is known, values stay as they are.
    """
    if known.all() or known.size == 1:
        return values
    height, width, *channels = values.shape
    half_height, half_width = -(-height // 2), -(-width // 2)
    total = np.zeros((half_height, half_width, *channels), np.float32)
    count = np.zeros((half_height, half_width), np.uint8)
    for down, right in np.ndindex(2, 2):
        inside = known[down::2, right::2]
        place = np.s_[: inside.shape[0], : inside.shape[1]]
        total[place] += np.where(_like(inside, values), values[down::2, right::2], np.float32(0))
        count[place] += inside
    total /= np.maximum(_like(count, total), 1)
    coarse = push_pull(total, count > 0)
    whole = np.empty_like(values)
    for rows in bands(height):
        beyond = upsampled(coarse, (2 * half_height, 2 * half_width), rows)[:, :width]
        whole[rows] = np.where(_like(known[rows], beyond), values[rows], beyond)
    return whole


def _like(picture: NDArray[np.generic], values: NDArray[np.float32]) -> NDArray[np.generic]:
    """A picture (H, W) that goes with values (H, W) or (H, W, C)."""
    return picture if values.ndim == 2 else picture[..., None]
