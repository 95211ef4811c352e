"""Feathering: a view's weight falls off towards its borders, to avoid visible seams."""

import numpy as np

from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.upsample import chosen_pixels
from mpsnet_core.scene.visibility import Visibility

# Width of the falloff, as a fraction of the mesh's size.
FEATHER = 0.03
# Factor at the border itself, not 0: a doubtful normal is better than none where no other view looks.
FAINTEST = 0.1
# Upper limit of the width, in pixels of the depth image.
WIDEST = 96


def feathered(visibility: Visibility, mask: Bools, width: float) -> F32:
    """(h, w) factors on a view's facing: FAINTEST at its borders, rising to 1 at the distance `width` from them.

    Like facing, the factor enters the weight by its fourth power: near its border, a view yields even to a glancing
    one. Borders are those of the image, of the mask (H, W), and depth discontinuities. If the camera is slightly off,
    pixels there show another part of the object, or the background.

    width: on the object, in world units. The result has the resolution of the visibility's depth image.
    """
    height, across = visibility.shape
    inside = visibility.unbroken & mask[np.ix_(*chosen_pixels(height, across, *mask.shape))]
    pixels = int(np.clip(round(width / visibility.footprint), 1, WIDEST))
    near = border_distance(inside, pixels) / np.float32(pixels)
    share: F32 = np.maximum(near * near * (3 - 2 * near), np.float32(FAINTEST))
    return share


def border_distance(inside: Bools, limit: int) -> F32:
    """(h, w) distance in pixels to the nearest pixel that is not inside, at most `limit`. Beyond the image is outside.

    An exact Euclidean distance transform: columns first, then rows.
    """
    padded = np.pad(inside, limit)
    row = np.arange(len(padded))[:, None]
    above = np.maximum.accumulate(np.where(padded, -1, row), axis=0)
    below = np.minimum.accumulate(np.where(padded, len(padded), row)[::-1], axis=0)[::-1]
    vertical = np.minimum(np.minimum(row - above, below - row), limit)[limit:-limit] ** 2
    width = inside.shape[1]
    nearest = np.full(inside.shape, limit**2)
    for step in range(-limit, limit + 1):
        np.minimum(nearest, vertical[:, limit + step : limit + step + width] + step**2, out=nearest)
    distance: F32 = np.sqrt(nearest).astype(np.float32)
    return distance
