"""What networks see: maps made from a capture, each by its name on a model's card."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture import Capture
from mpsnet_core.estimate.lambertian import grey_world_image, initial_normals, unmixed

# Channels of each map; all are zero outside the mask.
FEATURE_CHANNELS = {
    "photo": 3,  # unmixed, divided by its mean over the mask and all channels
    "grey_world": 3,  # unmixed, each channel divided by its own mean over the mask
    "initial_normals": 3,  # equation 2 on "photo"
    "initial_normals_grey_world": 3,  # equation 2 on "grey_world"
    "light_directions": 9,  # the three directions (x, y, z each), the same everywhere
    "mask": 1,
}


def feature_maps(capture: Capture, names: Iterable[str]) -> dict[str, NDArray[np.float32]]:
    """The named maps, each (C, H, W) float32, zero outside the mask."""
    return {name: _feature_map(capture, name) for name in names}


def _feature_map(capture: Capture, name: str) -> NDArray[np.float32]:
    mask, directions = capture.mask, capture.rig.directions
    if name == "photo":
        light = unmixed(capture)
        mean = float(light[mask].mean(dtype=np.float64))
        values = light / np.float32(mean if mean > 0 else 1)
    elif name == "grey_world":
        values = grey_world_image(unmixed(capture), mask)
    elif name == "initial_normals":
        values = initial_normals(unmixed(capture), directions)
    elif name == "initial_normals_grey_world":
        values = initial_normals(grey_world_image(unmixed(capture), mask), directions)
    elif name == "light_directions":
        values = np.broadcast_to(directions.ravel().astype(np.float32), (*mask.shape, 9))
    elif name == "mask":
        values = np.ones((*mask.shape, 1), np.float32)
    else:
        raise KeyError(name)
    return np.ascontiguousarray(np.where(mask[..., None], values, np.float32(0)).transpose(2, 0, 1))
