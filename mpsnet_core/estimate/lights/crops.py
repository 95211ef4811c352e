"""The object of a photo as the network of lights sees it: small, centred, scaled to fit, at several angles."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.resampling import bilinear, block_means

SIDE = 64  # pixels a side of a crop
ROOM = 1.06  # from a crop's centre to its border, in radii of the object
MAX_PIXELS = 136  # The object's longer side is reduced to at most this many before it is resampled.
# Lower limit of a channel's mean, as a share of the largest: an all-black channel must not divide by zero.
MIN_MEAN = 1e-4
# Each view is mirrored left to right or not, and then turned counter-clockwise by an angle in radians.
MIRRORED = np.tile([1.0, -1.0], 6)
ANGLES = np.repeat(np.arange(6) * np.pi / 3, 2)


def crops(pixels: NDArray[np.floating[Any]], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(V, SIDE, SIDE, 4) the object in each view: linear channels divided by their means, and the mask, 0 to 1.

    pixels: (H, W, 3). mask: (H, W), not empty.
    """
    values = _reduced(pixels, mask)
    rows, columns = np.nonzero(values[..., 3])
    y, x = rows.mean(), columns.mean()
    reach = max(float(np.hypot(rows - y, columns - x).max()), 1.0) * ROOM
    steps = np.linspace(-reach, reach, SIDE)
    across, down = np.meshgrid(steps, steps)
    cosine, sine, sign = (one[:, None, None] for one in (np.cos(ANGLES), np.sin(ANGLES), MIRRORED))
    # What a crop that was turned counter-clockwise shows at a place was clockwise of there.
    right = sign * (cosine * across - sine * down)
    # Black beyond the box. A pixel's centre is at its index + 0.5, and one more as of the border.
    bordered = np.pad(values, [(1, 1), (1, 1), (0, 0)])
    seen = bilinear(bordered, x + right + 1.5, y + sine * across + cosine * down + 1.5, np.float32)
    return np.asarray(seen, np.float32)


def into_views(vectors: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Vectors (V, N, 3) in camera space, as each view shows them."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    x = MIRRORED[:, None] * x
    cosine, sine = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


def out_of_views(vectors: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The inverse of :func:`into_views`."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    cosine, sine = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
    return np.stack([MIRRORED[:, None] * (cosine * x + sine * y), cosine * y - sine * x, z], axis=-1)


def _reduced(pixels: NDArray[np.floating[Any]], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(h, w, 4) the object's bounding box in blocks: channels divided by their means, and whether it covers a block."""
    box = bounding_box(mask)
    inside = mask[box][..., None]
    factor = -(-max(inside.shape) // MAX_PIXELS)
    means = block_means(np.concatenate([np.where(inside, pixels[box], 0), inside], axis=-1, dtype=np.float32), factor)
    covered = means[..., 3]
    known = covered > min(0.5, float(covered.max()) / 2)
    colour = np.where(known[..., None], means[..., :3] / np.maximum(covered, 1e-6)[..., None], 0)
    overall = colour[known].mean(axis=0)
    colour /= np.maximum(overall, max(MIN_MEAN * float(overall.max()), 1e-30))
    return np.concatenate([colour, known[..., None]], axis=-1, dtype=np.float32)
