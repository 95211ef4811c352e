"""Validation: a network's errors on held-out samples."""

from typing import NamedTuple

import numpy as np
import torch

from mpsnet_core.arrays.statistics import rank_correlation
from mpsnet_core.arrays.types import F32
from mpsnet_core.learning.training.inputs import Batch, concatenate_scales, inputs_with_previous_scale, sample_patches
from mpsnet_core.learning.training.loss import angle_between
from mpsnet_core.learning.training.networks import Network, Prediction
from mpsnet_core.learning.training.photo_simulation import PhotoSimulator

PATCHES_A_PICTURE = 200
PATCHES_AT_ONCE = 1000
PICTURES_AT_ONCE = 8


class Metrics(NamedTuple):
    """The error over all pixels of the samples."""

    mae_deg: float
    """Mean angular error in degrees."""
    highest_deg: float
    """Largest angular error in degrees."""
    rank_correlation: float | None
    """Spearman's, between expected and true error; None if the network predicts no error."""

    def __str__(self) -> str:
        rank = "" if self.rank_correlation is None else f", rank correlation {self.rank_correlation:.2f}"
        return f"{self.mae_deg:.2f}°{rank}"


@torch.no_grad()
def validate(network: Network, simulator: PhotoSimulator, patches_a_picture: int = PATCHES_A_PICTURE) -> Metrics:
    """Errors over all windows on all scales of each held-out sample, photographed once.

    patches_a_picture: number of pixels per sample, drawn with a fixed seed, that a patch-wise network estimates.
    """
    network.eval()
    errors, expected = [], []
    for start in range(0, len(simulator.samples), PICTURES_AT_ONCE):
        scales = simulator.batch(start // PICTURES_AT_ONCE, PICTURES_AT_ONCE)
        for scale in scales:  # the last batch repeats samples that were counted already; ignore them
            scale.weights[scale.examples >= len(simulator.samples) - start] = 0
        if network.kind == "patch":
            batch = concatenate_scales(scales, inputs_with_previous_scale(network, scales))
            patches = _patches(network, batch, patches_a_picture, start)
            errors += [_errors(network(*some.inputs), some)[0] for some in patches]
        else:
            for scale, seen in zip(scales, inputs_with_previous_scale(network, scales), strict=True):
                found, prediction = _errors(network(*seen), concatenate_scales([scale], [seen]))
                errors.append(found)
                expected += [] if prediction is None else [prediction]
    error = np.concatenate(errors).astype(np.float64)
    rank = rank_correlation(np.concatenate(expected), error) if expected else None
    return Metrics(float(error.mean()), float(error.max()), rank)


def _errors(prediction: Prediction, batch: Batch) -> tuple[F32, F32 | None]:
    counted = batch.weights > 0
    error = torch.rad2deg(angle_between(prediction.normals, batch.truth))[counted].float().cpu().numpy()
    if prediction.expected_error is None:
        return error, None
    return error, prediction.expected_error.squeeze(1)[counted].float().cpu().numpy()


def _patches(network: Network, batch: Batch, count: int, seed: int) -> list[Batch]:
    """`count` patches of each image, in several batches, because the maps of many patches take much memory."""
    generator = torch.Generator().manual_seed(seed)
    most = PATCHES_AT_ONCE // PICTURES_AT_ONCE
    return [sample_patches(batch, network, min(most, count - done), generator) for done in range(0, count, most)]
