"""Input features of the networks: maps made from a capture, by their names on a model's card."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture

# Channels of each map. Maps are zero outside the mask.
FEATURE_CHANNELS = {
    "photo": 3,  # unmixed, divided by its mean over the mask and all channels
    "grey_world": 3,  # unmixed, each channel divided by its own mean over the mask
    "initial_normals": 3,  # equation 2 on "photo"
    "initial_normals_grey_world": 3,  # equation 2 on "grey_world"
    "mask": 1,
    "previous": 4,  # pyramids: normals and expected error (radians) from the previous scale; zero on the first
    "lights": 9,  # the three directions (x, y, z each); one pixel, for an input of its own
    "channel_means": 3,  # of "photo" over the mask; one pixel
    "exact": 1,  # 1 if the lights and their mixing are known exactly, as in a render, else 0; one pixel
    "given": 2,  # 1 if "previous" is filled; 1 if a white photo removed the surface's colour; one pixel
}

# One value for the whole capture, of size 1 x 1: they cannot be stacked with maps.
CONSTANTS = frozenset({"lights", "channel_means", "given", "exact"})
# Lower limit of a channel's mean, as a share of the largest: an all-black channel must not divide by zero.
MIN_MEAN = 1e-4


def divide_by_means(image: NDArray[np.float32], means: NDArray[np.float64] | float) -> NDArray[np.float32]:
    """The image (..., 3) divided by one mean, or each channel by its own; by 1 if that is not above 0."""
    divisor: NDArray[np.float32] = np.where(np.greater(means, 0), means, 1).astype(np.float32)
    return image / divisor


def initial_normals(image: NDArray[np.float32], directions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Equation 2: ``n = L⁻¹ c``, normalised.

    image: (..., 3) linear, one channel per light. directions: (3, 3), one unit vector per row. Returns (..., 3) unit
    vectors in the frame of the directions; black pixels get +z.
    """
    return normalised(image @ np.linalg.inv(directions).T.astype(np.float32))


def channel_count(features: Iterable[str]) -> int:
    """Number of channels of an input that stacks these features."""
    return sum(FEATURE_CHANNELS[feature] for feature in features)


class PhotoCrop(NamedTuple):
    """A window of a photo on some scale, and properties of the whole photo."""

    light: NDArray[np.float32]
    """(H, W, 3). Unmixed image."""
    mask: NDArray[np.bool_]
    """(H, W). The object."""
    directions: NDArray[np.float64]
    """(3, 3). Light directions in camera space, one light per row."""
    means: NDArray[np.float64]
    """(3,). Mean of `light` over the whole mask."""
    previous: NDArray[np.float32] | None = None
    """(H, W, 4). The map "previous"; None on the first scale."""
    is_ground_truth: bool = False
    """Whether the lights are known exactly."""
    grey: bool = False
    """Whether a white photo removed the surface's colour."""


def feature_maps(capture: Capture, names: Iterable[str]) -> dict[str, NDArray[np.float32]]:
    """The named maps of a whole photo, each (C, H, W) float32 and zero outside the mask; constants are (C, 1, 1)."""
    crop = PhotoCrop(
        capture.rig.unmixed(capture.image),
        capture.mask,
        capture.rig.directions,
        mean_light(capture),
        is_ground_truth=capture.rig.is_ground_truth,
        grey=capture.white is not None,
    )
    return {name: feature_map(name, crop) for name in names}


def mean_light(capture: Capture) -> NDArray[np.float64]:
    """(3,) mean of the unmixed image over the mask."""
    total = np.zeros(3)
    for rows in bands(len(capture.mask)):
        total += np.einsum("hwc,hw->c", capture.image[rows], capture.mask[rows], dtype=np.float64)
    return np.linalg.solve(capture.rig.mixing, total / capture.mask.sum())


def feature_map(name: str, crop: PhotoCrop) -> NDArray[np.float32]:
    """The named map of a window, (C, H, W) float32 and zero outside the mask; constants are (C, 1, 1)."""
    light, mask, directions, means = crop.light, crop.mask, crop.directions, crop.means
    if name == "lights":
        return directions.astype(np.float32).reshape(9, 1, 1)
    if name == "channel_means":
        floor = np.maximum(means, MIN_MEAN * max(float(means.mean()), 1e-30))
        shares: NDArray[np.float64] = floor / floor.mean()
        return shares.astype(np.float32).reshape(3, 1, 1)
    if name == "given":
        return np.array([crop.previous is not None, crop.grey], np.float32).reshape(2, 1, 1)
    if name == "exact":
        return np.full((1, 1, 1), crop.is_ground_truth, np.float32)
    if name in ("photo", "initial_normals"):
        values = divide_by_means(light, means.mean())
    elif name in ("grey_world", "initial_normals_grey_world"):
        values = divide_by_means(light, means)
    elif name == "mask":
        values = np.ones((*mask.shape, 1), np.float32)
    elif name == "previous":
        values = np.zeros((*mask.shape, 4), np.float32) if crop.previous is None else crop.previous
    else:
        raise KeyError(name)
    if name.startswith("initial_normals"):
        values = initial_normals(values, directions)
    return np.where(mask[..., None], values, np.float32(0)).transpose(2, 0, 1)
