"""What is known inside an outline, carried on beyond it, so that whoever interpolates across it meets no step."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.surface.upsample import upsampled


def carried_on(values: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Values (H, W) as they are inside the mask, (H, W) bool and not empty, and going on smoothly outside it.

    By pull and push: each pixel outside takes what the smallest block of pixels around it holds that meets the mask
    (Gortler et al., The Lumigraph, SIGGRAPH 1996, section 3.4.2).
    """
    if mask.all():
        return values
    height, width = mask.shape
    half_height, half_width = -(-height // 2), -(-width // 2)
    total = np.empty((half_height, half_width), np.float32)
    count = np.empty((half_height, half_width), np.uint8)
    for rows in bands(half_height):
        taken = slice(2 * rows.start, min(2 * rows.stop, height))
        missing = ((0, 2 * (rows.stop - rows.start) - (taken.stop - taken.start)), (0, width % 2))
        inside = np.pad(mask[taken], missing)
        known = np.where(inside, np.pad(values[taken], missing), np.float32(0))
        total[rows] = known.reshape(-1, 2, half_width, 2).sum(axis=(1, 3))
        count[rows] = inside.reshape(-1, 2, half_width, 2).sum(axis=(1, 3))
    coarse = carried_on(total / np.maximum(count, 1), count > 0)
    whole = np.empty((height, width), np.float32)
    for rows in bands(height):
        beyond = upsampled(coarse, (2 * half_height, 2 * half_width), rows)[:, :width]
        whole[rows] = np.where(mask[rows], values[rows], beyond)
    return whole
