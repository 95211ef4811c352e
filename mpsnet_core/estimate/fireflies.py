"""Fireflies: single pixels of a render that are hundreds of times too bright, where few paths found a lamp by chance.

A network sees the photo divided by its mean, and its coarse scales are means of blocks: one such pixel of 1,000 in a
small photo is as bright as all others together. A highlight is no firefly, however bright: its light reaches the pixels
around it as well.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sampling import grid_step
from mpsnet_core.capture.capture import Capture

# A firefly is so many times as bright as the pixels around it, and as the bright ones of the object.
TIMES = 4.0
# What a bright pixel is, a percentile of the channel: more fireflies than above it no renderer leaves.
BRIGHT = 90
# Of the eight pixels around it by brightness, which is compared: two may be fireflies themselves.
RANK = 3
SAMPLED = 100_000  # pixels of a large photo
AROUND = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]


def without_fireflies(capture: Capture) -> Capture:
    """The capture with each firefly as bright as the third brightest of the pixels around it, channel by channel.

    Itself where there are none, and where a sensor took it: what that records ends where it clips.
    """
    if np.isfinite(capture.clip) or capture.clipped is not None:
        return capture
    image, mask = capture.image, capture.mask
    step = grid_step(np.count_nonzero(mask), SAMPLED)
    some = image[::step, ::step][mask[::step, ::step]]
    if not len(some):
        return capture
    bright = np.percentile(some.astype(np.float32), BRIGHT, axis=0)
    least = TIMES * np.where(bright > 0, bright, np.inf)  # a light that reaches few pixels shows no usual brightness
    for part in bands(len(image)):
        rows, columns, channels = np.nonzero((image[part] > least) & mask[part, :, None])
        rows += part.start
        around = [
            capture.image[_within(rows + down, image.shape[0]), _within(columns + right, image.shape[1]), channels]
            for down, right in AROUND
        ]
        usual = np.sort(around, axis=0)[-RANK]
        found = image[rows, columns, channels] > TIMES * usual
        if found.any():
            image = image.copy() if image is capture.image else image
            image[rows[found], columns[found], channels[found]] = usual[found]
    return capture if image is capture.image else replace(capture, image=image)


def _within(places: NDArray[np.intp], length: int) -> NDArray[np.intp]:
    """Places along a side; those beyond an end as far on this side of it."""
    return np.asarray(length - 1 - np.abs(length - 1 - np.abs(places)))
