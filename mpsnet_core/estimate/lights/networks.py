"""The two networks of lights: one that sees a photo, and one that also sees the normals estimated from it."""

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from onnxruntime import InferenceSession

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.estimate.lights.crops import crops, into_views, out_of_views
from mpsnet_core.estimate.onnx_model import open_session, run_session
from mpsnet_core.estimate.registry import MODELS_FOLDER
from mpsnet_core.scene.normal_map import NormalMap

PHOTO_NETWORK = MODELS_FOLDER / "lights.onnx"
NORMALS_NETWORK = MODELS_FOLDER / "lights_refined.onnx"
# The networks' expected errors of held-out photos, times this, are typical errors: the true light lies within twice of
# it in 19 of 20.
ERROR_SCALE = (1.0, 1.0)


class LightsGuess(NamedTuple):
    """Lights as far as a photo tells.

    directions: (3, 3) unit vectors in camera space, one light per row, in the order of the photo's channels. errors:
    (3,) their expected angular errors in radians.
    """

    directions: NDArray[np.float64]
    errors: NDArray[np.float64]


def lights_by_photo(pixels: NDArray[np.float32], mask: NDArray[np.bool_]) -> LightsGuess:
    """The lights of a photo and its mask, as :func:`mpsnet_core.estimate.lights.crops.reduced_object` returns them."""
    seen = crops(np.concatenate([pixels, mask[..., None]], axis=-1, dtype=np.float32), mask)
    return _guess(PHOTO_NETWORK, {"photo": seen[..., :3], "mask": seen[..., 3:]}, ERROR_SCALE[0])


def lights_by_normals(
    pixels: NDArray[np.float32], mask: NDArray[np.bool_], normals: NormalMap, lights: NDArray[np.float64]
) -> LightsGuess:
    """Better lights of a photo than those (3, 3) by which its normals were estimated. Others as above."""
    values = [pixels, mask[..., None], normals.confidence[..., None], normals.vectors]
    seen = crops(np.concatenate(values, axis=-1, dtype=np.float32), mask)
    inputs = {
        "photo": seen[..., :3],
        "mask": seen[..., 3:4],
        "confidence": seen[..., 4:5],
        "normals": into_views(seen[..., 5:]),
        "lights": into_views(np.broadcast_to(lights, (len(seen), 3, 3))),
    }
    return _guess(NORMALS_NETWORK, inputs, ERROR_SCALE[1])


def _guess(path: Path, inputs: dict[str, NDArray[np.floating[Any]]], scale: float) -> LightsGuess:
    """The mean of a network's answers for all views. scale: of its errors."""
    channels_first = {
        name: np.ascontiguousarray(np.moveaxis(value, -1, 1) if value.ndim == 4 else value, dtype=np.float32)
        for name, value in inputs.items()
    }
    directions, errors = (value.astype(np.float64) for value in run_session(_session(path), channels_first))
    together = normalised((out_of_views(directions) / errors[..., None] ** 2).sum(axis=0))
    return LightsGuess(together, scale * np.exp(np.log(errors).mean(axis=0)))


@cache
def _session(path: Path) -> InferenceSession:
    return open_session(path, "cpu", 0)
