"""Smooth extrapolation of an image into its unknown pixels."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.upsample import upsampled


def push_pull(values: F32, known: Bools) -> F32:
    """Values (H, W) or (H, W, C), extrapolated smoothly from where they are `known`, (H, W) bool, to all other pixels.

    An image pyramid: each level halves the image by the mean of the known pixels among four, and unknown pixels are
    interpolated bilinearly from the coarser level. This is push-pull of Gortler et al., "The Lumigraph" (SIGGRAPH
    1996), with full weight for a coarse pixel that contains any known one. If nothing is known, values are unchanged.
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


def _like(picture: NDArray[np.generic], values: F32) -> NDArray[np.generic]:
    """An image (H, W) in a shape that broadcasts with values (H, W) or (H, W, C)."""
    return picture if values.ndim == 2 else picture[..., None]
