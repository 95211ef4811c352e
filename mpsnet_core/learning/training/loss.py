"""The loss: angular error, and the squared error of the angular error that networks predict."""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from mpsnet_core.learning.training.networks.network import IntermediateOutputs, Prediction


class Loss(NamedTuple):
    """The loss of a batch and its parts."""

    total: Tensor
    """The loss to minimise."""
    angle: Tensor
    """Mean angular error in radians; for logs, without gradients."""
    expected: Tensor
    """Mean squared error of the expected error in radians squared, zero if the network predicts none; for logs, without
    gradients."""
    angles: Tensor
    """(N,). Mean angular error of each picture or patch in radians, without gradients."""


def angle_between(a: Tensor, b: Tensor) -> Tensor:
    """(N, ...) angles in radians between unit vectors (N, 3, ...).

    Computed by the tangent of the half angle (Kahan): accurate for small angles, and with a finite gradient where the
    vectors are equal, unlike the arc cosine.
    """
    # Squared lengths of the difference and of the sum, which make up four.
    difference = _squared_length(a - b)
    return 2 * torch.atan2(torch.sqrt(difference + 1e-12), torch.sqrt((4 - difference).clamp(min=0) + 1e-12))


def _squared_length(vectors: Tensor) -> Tensor:
    return (vectors * vectors).sum(dim=1)


# Auxiliary losses of networks with equation 2 inside.
LIT_WEIGHT = 0.05  # cross entropy of which lights reach
FORMULA_WEIGHT = 0.3  # error of equation 2 alone, where all lights reach
FORMULA_REACH = 0.3  # radians; errors of equation 2 beyond this, as on gloss, saturate
TRUST_WEIGHT = 1.0  # cross entropy of whether equation 2 is better than the network's own normals, times the difference


def loss_of(
    prediction: Prediction,
    truth: Tensor,
    weights: Tensor,
    error_weight: float,
    gradient_weight: float = 0.0,
    lit: Tensor | None = None,
) -> Loss:
    """Loss over the pixels (or patches) that count.

    truth: true normals, shaped as the prediction's. weights: (N, ...) 1 where a pixel counts, else 0. error_weight: of
    the expected error's loss. gradient_weight: of the mean difference between the gradients of predicted and true
    normals. lit: (N, 3, H, W) 1 where a light reaches.
    """
    angle = angle_between(prediction.normals, truth)
    # The sums over each picture or patch.
    angles, counts = (values.reshape(len(weights), -1).sum(1) for values in (angle * weights, weights))
    count = counts.sum().clamp(min=1)
    mean = angles.sum() / count
    total, expected = mean, torch.zeros_like(mean)
    if prediction.expected_error is not None:
        residual = prediction.expected_error.squeeze(1) - angle.detach()
        expected = (residual * residual * weights).sum() / count
        total = total + error_weight * expected
    if gradient_weight:
        total = total + gradient_weight * _gradient_length(prediction.normals - truth, weights)
    if prediction.intermediate is not None and lit is not None:
        total = total + (_auxiliary_loss(prediction.intermediate, truth, lit) * weights).sum() / count
    return Loss(total, mean.detach(), expected.detach(), angles.detach() / counts.clamp(min=1))


def _auxiliary_loss(intermediate: IntermediateOutputs, truth: Tensor, lit: Tensor) -> Tensor:
    """(N, H, W) auxiliary loss of each pixel, for networks with equation 2 inside."""
    entropy = functional.binary_cross_entropy_with_logits
    off, own = angle_between(intermediate.formula, truth), angle_between(intermediate.own, truth).detach()
    reached = lit.amin(dim=1) > 0.5
    better = (off < own).float()
    return (
        LIT_WEIGHT * entropy(intermediate.lit, lit, reduction="none").mean(dim=1)
        + FORMULA_WEIGHT * off / (1 + off / FORMULA_REACH) * reached
        + TRUST_WEIGHT * (off - own).abs().detach() * entropy(intermediate.trust.squeeze(1), better, reduction="none")
    )


def _gradient_length(values: Tensor, weights: Tensor) -> Tensor:
    """Mean length of the differences between neighbouring pixels of (N, 3, H, W), where both count."""
    total, count = torch.zeros((), device=values.device), torch.zeros((), device=values.device)
    for axis in (1, 2):
        both = weights.narrow(axis, 1, weights.shape[axis] - 1) * weights.narrow(axis, 0, weights.shape[axis] - 1)
        total = total + (torch.sqrt(_squared_length(values.diff(dim=axis + 1)) + 1e-12) * both).sum()
        count = count + both.sum()
    return total / count.clamp(min=1)
