"""Feathering: a view counts less and less towards its borders, so that none begins or ends with a step."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.upsample import chosen_pixels
from mpsnet_core.scene.visibility import Visibility

# As a share of the mesh's size.
FEATHER = 0.03
# What is left at the very border: a doubtful normal is better than none where no other view looks.
FAINTEST = 0.1
# No wider than this many of the depth image's pixels.
WIDEST = 96


def feathered(visibility: Visibility, mask: NDArray[np.bool_], width: float) -> NDArray[np.float32]:
    """(h, w) what a view's facing is multiplied by: 1 where all its borders are `width` or more away, FAINTEST there.

    As facing, it counts by its fourth power: so a view that ends yields to one that glances well before its end.
    Borders are those of the image, of the mask (H, W) and of whatever stands before something else. With a camera that
    is slightly wrong the pixels there show another part, or the background. width: on the object, in world units.
    The result has the pixels of the visibility's depth image.
    """
    height, across = visibility.shape
    inside = visibility.unbroken & mask[np.ix_(*chosen_pixels(height, across, *mask.shape))]
    pixels = int(np.clip(round(width / visibility.footprint), 1, WIDEST))
    near = border_distance(inside, pixels) / np.float32(pixels)
    share: NDArray[np.float32] = np.maximum(near * near * (3 - 2 * near), np.float32(FAINTEST))
    return share


def border_distance(inside: NDArray[np.bool_], limit: int) -> NDArray[np.float32]:
    """(h, w) pixels from each pixel to the nearest one that is not inside, at most `limit`; all around is outside."""
    padded = np.pad(inside, limit)
    row = np.arange(len(padded))[:, None]
    above = np.maximum.accumulate(np.where(padded, -1, row), axis=0)
    below = np.minimum.accumulate(np.where(padded, len(padded), row)[::-1], axis=0)[::-1]
    vertical = np.minimum(np.minimum(row - above, below - row), limit)[limit:-limit] ** 2
    width = inside.shape[1]
    nearest = np.full(inside.shape, limit**2)
    for step in range(-limit, limit + 1):
        np.minimum(nearest, vertical[:, limit + step : limit + step + width] + step**2, out=nearest)
    distance: NDArray[np.float32] = np.sqrt(nearest).astype(np.float32)
    return distance
