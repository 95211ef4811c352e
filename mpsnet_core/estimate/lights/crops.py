"""The object of a photo as the networks of lights see it: small, centred, scaled to fit, at several angles."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.block_means import block_means
from mpsnet_core.arrays.mask_regions import bounding_box

SIDE = 64  # pixels a side of a crop
ROOM = 1.06  # from a crop's centre to its border, in radii of the object
# The object's longer side is reduced to at most this many pixels, on which its normals are estimated, too.
MAX_PIXELS = 136
# Lower limit of a channel's mean, as a share of the largest: an all-black channel must not divide by zero.
MIN_MEAN = 1e-4
# A crop's angle counter-clockwise, and whether it is mirrored left to right before.
VIEWS = [(angle, mirrored) for angle in np.arange(6) * np.pi / 3 for mirrored in (False, True)]


def reduced_object(
    pixels: NDArray[np.floating[Any]], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A photo (H, W, 3) and the object's mask (H, W), cut out and reduced; each channel is divided by its mean."""
    box = bounding_box(mask, 2)
    inside = mask[box][..., None]
    factor = -(-max(inside.shape) // MAX_PIXELS)
    means = block_means(np.concatenate([np.where(inside, pixels[box], 0), inside], axis=-1, dtype=np.float32), factor)
    covered = means[..., 3]
    known = covered > min(0.5, float(covered.max()) / 2)
    colour = np.where(known[..., None], means[..., :3] / np.maximum(covered, 1e-6)[..., None], 0)
    overall = colour[known].mean(axis=0)
    return colour / np.maximum(overall, max(MIN_MEAN * float(overall.max()), 1e-30)), known


def crops(values: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(V, SIDE, SIDE, C) an object's values (H, W, C) in each of the :data:`VIEWS`, about its centroid.

    Values are moved, not turned: those that are vectors have yet to be, see :func:`into_views`.
    """
    rows, columns = np.nonzero(mask)
    y, x = rows.mean(), columns.mean()
    reach = max(float(np.hypot(rows - y, columns - x).max()), 1.0) * ROOM
    steps = np.linspace(-reach, reach, SIDE)
    across, down = np.meshgrid(steps, steps)
    angles, signs = _angles_and_signs()
    cosine, sine = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    # What a crop that was turned counter-clockwise shows at a place was clockwise of there.
    right = (cosine * across - sine * down) * signs[:, None, None]
    return _bilinear(values * mask[..., None], y + sine * across + cosine * down, x + right)


def into_views(vectors: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Vectors (V, ..., 3) in camera space, as the crop of each view shows them."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    cosine, sine, signs = _shaped(x.ndim)
    x = x * signs
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


def out_of_views(vectors: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The inverse of :func:`into_views`."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    cosine, sine, signs = _shaped(x.ndim)
    return np.stack([(cosine * x + sine * y) * signs, cosine * y - sine * x, z], axis=-1)


def _angles_and_signs() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([angle for angle, _ in VIEWS]), np.array([-1.0 if mirrored else 1.0 for _, mirrored in VIEWS])


def _shaped(dimensions: int) -> tuple[NDArray[np.float64], ...]:
    angles, signs = _angles_and_signs()
    shape = (-1, *(1,) * (dimensions - 1))
    return np.cos(angles).reshape(shape), np.sin(angles).reshape(shape), signs.reshape(shape)


def _bilinear(values: NDArray[np.float32], y: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float32]:
    """(N, H, W, C) values (h, w, C) at places (N, H, W) in pixels; zero beyond."""
    padded = np.pad(values, [(1, 1), (1, 1), (0, 0)])
    y, x = (np.clip(place + 1, 0, size - 1) for place, size in zip((y, x), padded.shape[:2], strict=True))
    top, left = (np.minimum(p.astype(int), s - 2) for p, s in zip((y, x), padded.shape[:2], strict=True))
    down, right = (y - top)[..., None].astype(np.float32), (x - left)[..., None].astype(np.float32)
    upper = padded[top, left] * (1 - right) + padded[top, left + 1] * right
    lower = padded[top + 1, left] * (1 - right) + padded[top + 1, left + 1] * right
    return np.asarray(upper * (1 - down) + lower * down, np.float32)
