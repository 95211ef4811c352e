"""What networks see: maps made from a capture, each by its name on a model's card."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.capture import Capture
from mpsnet_core.estimate.lambertian import divided, initial_normals

# Channels of each map; maps are zero outside the mask.
FEATURE_CHANNELS = {
    "photo": 3,  # unmixed, divided by its mean over the mask and all channels
    "grey_world": 3,  # unmixed, each channel divided by its own mean over the mask
    "initial_normals": 3,  # equation 2 on "photo"
    "initial_normals_grey_world": 3,  # equation 2 on "grey_world"
    "mask": 1,
    "white": 3,  # the white photo, each channel divided by its own mean over the mask; zero where it tells nothing
    "previous": 4,  # of pyramids: normals and expected error (radians) on the scale before; zero on the first
    "lights": 9,  # the three directions (x, y, z each); one pixel, for an input of its own
    "channel_means": 3,  # of "photo" over the mask; one pixel
    "given": 2,  # 1 where there is an answer of the scale before, and where there is a white photo, else 0; one pixel
}

# Not maps: one pixel that holds for the whole capture, so they cannot be stacked with maps.
CONSTANTS = frozenset({"lights", "channel_means", "given"})


def feature_maps(capture: Capture, names: Iterable[str]) -> dict[str, NDArray[np.float32]]:
    """The named maps, each (C, H, W) float32 and zero outside the mask; constants are (C, 1, 1)."""
    light, means = capture.rig.unmixed(capture.image), mean_light(capture)
    return {name: window_map(name, light, capture.mask, capture.rig.directions, means) for name in names}


def mean_light(capture: Capture) -> NDArray[np.float64]:
    """(3,) what each light alone gives (unmixed), as its mean over the mask."""
    total = np.zeros(3)
    for rows in bands(len(capture.mask)):
        total += capture.image[rows][capture.mask[rows]].sum(axis=0, dtype=np.float64)
    return np.linalg.solve(capture.rig.mixing, total / capture.mask.sum())


def window_map(
    name: str,
    light: NDArray[np.float32],
    mask: NDArray[np.bool_],
    directions: NDArray[np.float64],
    means: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The named map of a window of a photo, as of :func:`feature_maps`.

    light: (H, W, 3) what each light alone gives. mask: (H, W). directions: (3, 3), a light a row. means: (3,) of the
    whole photo, see :func:`mean_light`.
    """
    if name == "lights":
        return directions.astype(np.float32).reshape(9, 1, 1)
    if name in ("photo", "initial_normals"):
        values = divided(light, means.mean())
    elif name in ("grey_world", "initial_normals_grey_world"):
        values = divided(light, means)
    elif name == "mask":
        values = np.ones((*mask.shape, 1), np.float32)
    else:
        raise KeyError(name)
    if name.startswith("initial_normals"):
        values = initial_normals(values, directions)
    return np.ascontiguousarray(np.where(mask[..., None], values, np.float32(0)).transpose(2, 0, 1))
