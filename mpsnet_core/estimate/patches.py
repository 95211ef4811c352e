"""Patch-wise networks: one small patch around every pixel of the object, in batches."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.card import ModelCard
from mpsnet_core.estimate.dense import NetworkRunner
from mpsnet_core.estimate.features import CONSTANTS, feature_maps
from mpsnet_core.progress import Progress

# The values between a network's layers stay in the processor's last cache.
PATCHES_A_BATCH = 128


def predict_patches(
    network: NetworkRunner, card: ModelCard, capture: Capture, progress: Progress
) -> NDArray[np.float32]:
    """(H, W, 4) normals of `capture`, not normalised, and their confidence; zero outside the mask."""
    side, reach = card.patch, card.patch // 2
    box = bounding_box(capture.mask)
    mask = capture.mask[box]
    # Maps are zero outside the mask, so the bounding box holds all of them.
    cut = Capture(capture.image[box], mask, capture.rig, white=None if capture.white is None else capture.white[box])
    maps = feature_maps(cut, {name for names in card.inputs.values() for name in names})
    inputs = {name: np.concatenate([maps[f] for f in features]) for name, features in card.inputs.items()}
    # Constants are shared by all patches; the other inputs are views, indexed by each patch's middle pixel.
    constants = {name: values for name, values in inputs.items() if CONSTANTS.intersection(card.inputs[name])}
    windows = {
        name: np.lib.stride_tricks.sliding_window_view(
            np.pad(values, [(0, 0), (reach, reach), (reach, reach)]), (len(values), side, side)
        )[0]
        for name, values in inputs.items()
        if name not in constants
    }
    output = np.zeros((*capture.mask.shape, 4), np.float32)
    inside = output[box]
    rows, columns = np.nonzero(mask)
    for some in bands(len(rows), PATCHES_A_BATCH):
        progress(some.start / len(rows), f"pixel {some.start} of {len(rows)}")
        y, x = rows[some], columns[some]
        batch = {name: view[y, x] for name, view in windows.items()}
        batch |= {name: np.broadcast_to(values, (len(y), *values.shape)) for name, values in constants.items()}
        inside[y, x] = np.concatenate(network(batch, len(y)), axis=1)
    return output
