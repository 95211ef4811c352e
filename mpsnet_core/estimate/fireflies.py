"""Remove fireflies: single pixels of a path-traced render that are hundreds of times too bright.

A network sees the photo divided by its mean, and its coarse scales are means of blocks. One firefly among 1,000 pixels
can be as bright as all the others together. A highlight is not a firefly, however bright: the pixels around it
are bright, too.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.capture.capture import Capture

# A firefly is brighter than its neighbours, and than the object's bright pixels, by more than this factor.
TIMES = 4.0
# The channel's percentile that counts as bright; no renderer leaves more fireflies than lie above it.
BRIGHT = 90
# The neighbour to compare with is the third brightest of eight: two may be fireflies themselves.
RANK = 3
SAMPLED = 100_000  # pixels of a large photo
AROUND = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]


def remove_fireflies(capture: Capture) -> Capture:
    """Replace each firefly by its third brightest neighbour, channel by channel.

    A capture without fireflies, or from a sensor, is returned unchanged: a sensor clips.
    """
    if np.isfinite(capture.clip) or capture.clipped is not None:
        return capture
    image, mask = capture.image, capture.mask
    step = grid_step(np.count_nonzero(mask), SAMPLED)
    some = image[::step, ::step][mask[::step, ::step]]
    if not len(some):
        return capture
    bright = np.percentile(some.astype(np.float32), BRIGHT, axis=0)
    least = TIMES * np.where(bright > 0, bright, np.inf)  # skip a light that reaches few pixels
    for part in bands(len(image)):
        rows, columns, channels = np.nonzero((image[part] > least) & mask[part, :, None])
        rows += part.start
        around = [
            capture.image[
                _mirrored_indices(rows + down, image.shape[0]),
                _mirrored_indices(columns + right, image.shape[1]),
                channels,
            ]
            for down, right in AROUND
        ]
        usual = np.sort(around, axis=0)[-RANK]
        found = image[rows, columns, channels] > TIMES * usual
        if found.any():
            image = image.copy() if image is capture.image else image
            image[rows[found], columns[found], channels[found]] = usual[found]
    return capture if image is capture.image else replace(capture, image=image)


def _mirrored_indices(places: NDArray[np.intp], length: int) -> NDArray[np.intp]:
    """Indices along a side, mirrored at its ends."""
    return np.asarray(length - 1 - np.abs(length - 1 - np.abs(places)))
