"""The network that tells a photo's lights from its shading and outline."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from onnxruntime import InferenceSession

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.estimate.lights.crops import crops, out_of_views
from mpsnet_core.estimate.onnx_model import open_session, run_session
from mpsnet_core.estimate.registry import MODELS_FOLDER

NETWORK = MODELS_FOLDER / "lights.onnx"
# Factor on the network's own errors that makes 19 of 20 lights of held-out samples lie within twice of them.
ERROR_SCALE = 2.25


class LightsGuess(NamedTuple):
    """Lights as far as a photo tells."""

    directions: NDArray[np.float64]
    """(3, 3) unit vectors in camera space, one light per row, in the order of the photo's channels."""
    errors: NDArray[np.float64]
    """(3,) expected angular errors in radians."""


def guess_lights(pixels: NDArray[np.floating[Any]], mask: NDArray[np.bool_]) -> LightsGuess:
    """The lights of a photo (H, W, 3) of an object with its mask (H, W): the mean of what each view tells.

    Crosstalk is part of the directions: those that explain each channel best.
    """
    seen = np.moveaxis(crops(pixels, mask), -1, 1)
    inputs = {"photo": np.ascontiguousarray(seen[:, :3]), "mask": np.ascontiguousarray(seen[:, 3:])}
    directions, errors = (value.astype(np.float64) for value in run_session(_session(), inputs))
    together = normalised((out_of_views(directions) / errors[..., None] ** 2).sum(axis=0))
    return LightsGuess(together, ERROR_SCALE * np.exp(np.log(errors).mean(axis=0)))


@cache
def _session() -> InferenceSession:
    return open_session(NETWORK, "cpu", 0)
