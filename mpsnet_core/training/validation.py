"""Validation: how well a network does on samples that it was not trained on."""

from typing import NamedTuple

import numpy as np
import torch
from torch.utils.data import DataLoader

from mpsnet_core.errors import InputError
from mpsnet_core.evaluation.confidence import rank_correlation
from mpsnet_core.training.examples import Examples, collated, on_device, patches_of
from mpsnet_core.training.loss import angle_between
from mpsnet_core.training.networks import Network
from mpsnet_core.training.photographing import Photographer
from mpsnet_core.training.pyramid import with_previous

PATCHES_A_PICTURE = 200
PATCHES_AT_ONCE = 1000
PICTURES_AT_ONCE = 8


class Figures(NamedTuple):
    """mae_deg, highest_deg: mean and largest angular error over all pixels. rank_correlation: Spearman's, between the
    error that the network expects and the true one; None where it expects none."""

    mae_deg: float
    highest_deg: float
    rank_correlation: float | None

    def __str__(self) -> str:
        rank = "" if self.rank_correlation is None else f", rank correlation {self.rank_correlation:.2f}"
        return f"{self.mae_deg:.2f}°{rank}"


@torch.no_grad()
def validate_scales(network: Network, photographer: Photographer) -> Figures:
    """Over all windows on all scales of each held-out sample, photographed once."""
    network.eval()
    errors, expected = [], []
    for start in range(0, len(photographer.samples), PICTURES_AT_ONCE):
        scales = photographer.batch(start // PICTURES_AT_ONCE, PICTURES_AT_ONCE)
        for scale, inputs in zip(scales, with_previous(network, scales), strict=True):
            prediction = network(*inputs)
            counted = scale.weights > 0
            assert prediction.expected_error is not None
            errors.append(angle_between(prediction.normals, scale.truth)[counted].float().cpu().numpy())
            expected.append(prediction.expected_error.squeeze(1)[counted].float().cpu().numpy())
    error = np.degrees(np.concatenate(errors), dtype=np.float64)
    return Figures(float(error.mean()), float(error.max()), rank_correlation(np.concatenate(expected), error))


@torch.no_grad()
def validate(
    network: Network, examples: Examples, device: torch.device, patches_a_picture: int = PATCHES_A_PICTURE
) -> Figures:
    """Over all the examples, each as its first epoch photographs it.

    patches_a_picture: how many pixels of each, drawn with a fixed seed, a patch-wise network is asked for.
    """
    network.eval()
    errors, expected = [], []
    for number, batch in enumerate(DataLoader(examples, batch_size=1, collate_fn=collated)):
        batch = on_device(batch, device)
        if not batch.weights.any():
            continue
        parts = [batch]
        if network.kind == "patch":
            generator = torch.Generator().manual_seed(number)
            # Part by part, because the maps of many patches take much memory.
            counts = [min(PATCHES_AT_ONCE, patches_a_picture - k) for k in range(0, patches_a_picture, PATCHES_AT_ONCE)]
            parts = [patches_of(batch, network, count, generator) for count in counts]
        for one in parts:
            prediction = network(*one.inputs)
            counted = one.weights > 0
            errors.append(angle_between(prediction.normals, one.truth)[counted].float().cpu().numpy())
            if prediction.expected_error is not None:
                expected.append(prediction.expected_error.squeeze(1)[counted].float().cpu().numpy())
    if not errors:
        raise InputError("no pixel of the held-out samples has a known normal; make them again")
    error = np.degrees(np.concatenate(errors), dtype=np.float64)
    rank = rank_correlation(np.concatenate(expected), error) if expected else None
    return Figures(float(error.mean()), float(error.max()), rank)
