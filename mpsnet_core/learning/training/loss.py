"""Loss: the angle to the true normal, and for networks that expect an error of themselves, how well they do."""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from mpsnet_core.learning.training.networks import Prediction


class Loss(NamedTuple):
    """total: what is minimised. angle: radians, mean over the pixels that count. expected: mean squared error of the
    expected error, radians squared; zero where the network gives none. The last two are for people, without slopes."""

    total: Tensor
    angle: Tensor
    expected: Tensor


def angle_between(a: Tensor, b: Tensor) -> Tensor:
    """Radians between unit vectors along axis 1: (N, 3, ...) and (N, 3, ...) give (N, ...).

    By the half angle's tangent (Kahan): exact for small angles, and unlike the arc cosine's its gradient stays finite
    where the vectors meet.
    """
    difference, total = a - b, a + b
    return 2 * torch.atan2(_length(difference), _length(total))


def _length(vectors: Tensor) -> Tensor:
    return torch.sqrt((vectors * vectors).sum(dim=1) + 1e-12)


LIT_WEIGHT = 0.05  # of the cross entropy of which lights reach, where the network says so


def loss_of(
    prediction: Prediction,
    truth: Tensor,
    weights: Tensor,
    error_weight: float,
    gradient_weight: float = 0.0,
    lit: Tensor | None = None,
) -> Loss:
    """Over the pixels (or patches) that count.

    truth: as the normals. weights: (N, ...) 1 where a pixel counts, else 0. gradient_weight: of the mean difference
    between the normals' steps from pixel to pixel and the true ones. lit: (N, 3, H, W) 1 where a light reaches.
    """
    count = weights.sum().clamp(min=1)
    angle = angle_between(prediction.normals, truth)
    mean = (angle * weights).sum() / count
    if prediction.expected_error is None:
        return Loss(mean, mean.detach(), torch.zeros_like(mean))
    missed = prediction.expected_error.squeeze(1) - angle.detach()
    expected = (missed * missed * weights).sum() / count
    total = mean + error_weight * expected
    if gradient_weight:
        total = total + gradient_weight * _step_difference(prediction.normals - truth, weights)
    if prediction.lit is not None and lit is not None:
        entropy = functional.binary_cross_entropy_with_logits(prediction.lit, lit, reduction="none").mean(dim=1)
        total = total + LIT_WEIGHT * (entropy * weights).sum() / count
    return Loss(total, mean.detach(), expected.detach())


def _step_difference(missed: Tensor, weights: Tensor) -> Tensor:
    """Mean length of the steps from pixel to pixel of what is missed, (N, 3, H, W), where both pixels count."""
    total, count = torch.zeros((), device=missed.device), torch.zeros((), device=missed.device)
    for axis in (1, 2):
        both = weights.narrow(axis, 1, weights.shape[axis] - 1) * weights.narrow(axis, 0, weights.shape[axis] - 1)
        total = total + (_length(missed.diff(dim=axis + 1)) * both).sum()
        count = count + both.sum()
    return total / count.clamp(min=1)
