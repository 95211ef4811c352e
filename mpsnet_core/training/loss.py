"""Loss: the angle to the true normal, and for networks that expect an error of themselves, how well they do."""

from typing import NamedTuple

import torch
from torch import Tensor

from mpsnet_core.training.networks import Prediction


class Loss(NamedTuple):
    """total: what is minimised. angle: radians, mean over the pixels that count. expected: mean squared error of the
    expected error, radians squared; zero where the network gives none. The last two are for people, without slopes."""

    total: Tensor
    angle: Tensor
    expected: Tensor


def angle_between(a: Tensor, b: Tensor) -> Tensor:
    """Radians between unit vectors along axis 1: (N, 3, ...) and (N, 3, ...) give (N, ...).

    By the half angle's tangent (Kahan): exact for small angles, and unlike the arc cosine's its slope stays finite
    where the vectors meet.
    """
    difference, total = a - b, a + b
    return 2 * torch.atan2(_length(difference), _length(total))


def _length(vectors: Tensor) -> Tensor:
    return torch.sqrt((vectors * vectors).sum(dim=1) + 1e-12)


def loss_of(prediction: Prediction, truth: Tensor, weights: Tensor, error_weight: float) -> Loss:
    """Over the pixels (or patches) that count.

    truth: as the normals. weights: (N, ...) 1 where a pixel counts, else 0.
    """
    count = weights.sum().clamp(min=1)
    angle = angle_between(prediction.normals, truth)
    mean = (angle * weights).sum() / count
    if prediction.expected_error is None:
        return Loss(mean, mean.detach(), torch.zeros_like(mean))
    missed = prediction.expected_error.squeeze(1) - angle.detach()
    expected = (missed * missed * weights).sum() / count
    return Loss(mean + error_weight * expected, mean.detach(), expected.detach())
