"""Coarse to fine in training: each scale sees the network's own answer on the scale before."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from mpsnet_core.estimate.features import CONSTANTS
from mpsnet_core.training.examples import Batch
from mpsnet_core.training.networks import Network, Prediction
from mpsnet_core.training.networks.network import unit
from mpsnet_core.training.photographing import Scale


@torch.no_grad()
def with_previous(network: Network, scales: Sequence[Scale]) -> list[tuple[Tensor, ...]]:
    """The network's inputs for each scale, with its answers (as in use: not in training mode) on the scale before."""
    was = network.training
    network.eval()
    inputs, previous = [], None
    for number, scale in enumerate(scales):
        mask = scale.maps["mask"]
        if previous is None:
            previous = mask.new_zeros(len(mask), 4, *mask.shape[2:])
        seen = _inputs(network, {**scale.maps, "previous": previous * mask})
        inputs.append(seen)
        if number + 1 < len(scales):
            previous = _enlarged(network(*seen), scale, scales[number + 1])
    network.train(was)
    return inputs


def joined(scales: Sequence[Scale], inputs: Sequence[tuple[Tensor, ...]]) -> tuple[Batch, Tensor]:
    """All scales' windows as one batch, and which lights reach them."""
    together = tuple(torch.cat(values) for values in zip(*inputs, strict=True))
    batch = Batch(
        together, torch.cat([scale.truth for scale in scales]), torch.cat([scale.weights for scale in scales])
    )
    return batch, torch.cat([scale.lit for scale in scales])


def _inputs(network: Network, maps: dict[str, Tensor]) -> tuple[Tensor, ...]:
    made = []
    for names in network.inputs.values():
        parts = [maps[name] for name in names]
        assert len({name in CONSTANTS for name in names}) == 1
        made.append(torch.cat(parts, dim=1))
    return tuple(made)


def _enlarged(prediction: Prediction, scale: Scale, finer: Scale) -> Tensor:
    """(M, 4, H, W) normals and expected error where the finer scale's windows are, at twice the resolution."""
    assert prediction.expected_error is not None
    side = scale.weights.shape[-1] // 2
    where = {int(example): place for place, example in enumerate(scale.examples)}
    answer = torch.cat([prediction.normals, prediction.expected_error, scale.maps["mask"]], dim=1).float()
    answer[:, :4] *= answer[:, 4:]
    parts = [
        answer[where[int(example)], :, top : top + side, left : left + side]
        for example, (top, left) in zip(finer.examples, finer.places, strict=True)
    ]
    large = functional.interpolate(torch.stack(parts), scale_factor=2, mode="bilinear", align_corners=False)
    values = large[:, :4] / large[:, 4:].clamp(min=1e-3)
    return torch.cat([unit(values[:, :3]), values[:, 3:]], dim=1)
