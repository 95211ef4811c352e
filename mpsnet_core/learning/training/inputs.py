"""Inputs of networks: stacked maps, with the output on the previous scale for pyramids, or cut into patches."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from mpsnet_core.arrays.types import I64
from mpsnet_core.estimate.features import CONSTANTS
from mpsnet_core.learning.training.networks import Network, Prediction
from mpsnet_core.learning.training.networks.network import unit
from mpsnet_core.learning.training.photo_simulation import Scale, unmixed


class Batch(NamedTuple):
    """N examples as a network is trained with them."""

    inputs: tuple[Tensor, ...]
    """(N, C, H, W) each. The inputs in the network's order."""
    truth: Tensor
    """(N, 3, H, W). True unit normals."""
    weights: Tensor
    """(N, H, W). 1 for pixels inside the mask with a known true normal, else 0."""
    lit: Tensor | None = None
    """(N, 3, H, W). 1 where a light reaches, else 0; None for patches."""


@torch.no_grad()
def inputs_with_previous_scale(network: Network, scales: Sequence[Scale]) -> list[tuple[Tensor, ...]]:
    """A network's inputs for each scale, with its output on the previous scale.

    network: in evaluation mode.
    """
    mask = scales[0].maps["mask"]
    inputs, previous = [], mask.new_zeros(len(mask), 4, *mask.shape[2:])
    for scale, finer in zip(scales, [*scales[1:], None], strict=True):
        maps = {**scale.maps, "previous": previous * scale.maps["mask"]}
        stacks = network.inputs.values()
        inputs.append(tuple(torch.cat([feature_tensor(name, maps) for name in names], dim=1) for names in stacks))
        if finer is not None:
            window_of = {int(example): number for number, example in enumerate(scale.examples)}
            continued = [window_of[int(example)] for example in finer.examples]
            prediction = network(*(values[continued] for values in inputs[-1]))
            previous = _enlarged(prediction, maps["mask"][continued], finer.places)
    return inputs


def feature_tensor(name: str, maps: Mapping[str, Tensor]) -> Tensor:
    """The named map, as :func:`mpsnet_core.estimate.features.feature_map` computes it."""
    if name == "grey_world":
        return maps["photo"] / maps["channel_means"]
    if not name.startswith("initial_normals"):
        return maps[name]
    light = feature_tensor("grey_world" if name.endswith("grey_world") else "photo", maps)
    solved = unmixed(light, maps["lights"].reshape(-1, 3, 3))
    solved[:, 2] += (solved == 0).all(dim=1)  # a black pixel faces the camera
    return unit(solved) * maps["mask"]


def concatenate_scales(scales: Sequence[Scale], inputs: Sequence[tuple[Tensor, ...]]) -> Batch:
    """The windows of all scales as one batch."""
    return Batch(
        tuple(torch.cat(values) for values in zip(*inputs, strict=True)),
        *(torch.cat([getattr(scale, name) for scale in scales]) for name in ("truth", "weights", "lit")),
    )


def _enlarged(prediction: Prediction, mask: Tensor, places: I64) -> Tensor:
    """(M, 4, H, W) normals and expected error in the finer scale's windows, upsampled to twice the resolution.

    mask: (M, 1, H, W) the windows'. places: (M, 2) corners of the finer windows in them, see :class:`Scale`.
    """
    assert prediction.expected_error is not None
    side = mask.shape[-1] // 2
    output = torch.cat([prediction.normals, prediction.expected_error, mask], dim=1).float()
    output[:, :4] *= output[:, 4:]
    parts = [one[:, top : top + side, left : left + side] for one, (top, left) in zip(output, places, strict=True)]
    large = functional.interpolate(torch.stack(parts), scale_factor=2, mode="bilinear", align_corners=False)
    values = large[:, :4] / large[:, 4:].clamp(min=1e-3)
    return torch.cat([unit(values[:, :3]), values[:, 3:]], dim=1)


def sample_patches(batch: Batch, network: Network, count: int, generator: torch.Generator) -> Batch:
    """`count` patches from each image of a batch, around pixels that count; images without any are skipped.

    inputs become (N * count, C, patch, patch), zero beyond the image; truth (N * count, 3); weights (N * count,).
    Constant inputs such as "lights" are repeated for each patch.
    """
    pictures, pixels = [], []
    width = batch.weights.shape[2]
    for number, weights in enumerate(batch.weights):
        places = torch.nonzero(weights.flatten() > 0).squeeze(1).cpu()
        if len(places):
            chosen = places[torch.randint(len(places), (count,), generator=generator)]
            pixels.append(chosen)
            pictures.append(torch.full_like(chosen, number))
    device = batch.truth.device
    picture, pixel = torch.cat(pictures).to(device), torch.cat(pixels).to(device)
    y, x = pixel // width, pixel % width
    reach = network.patch // 2
    offsets = torch.arange(network.patch, device=device)
    rows, columns = (y[:, None] + offsets)[:, :, None], (x[:, None] + offsets)[:, None, :]
    inputs = []
    for names, values in zip(network.inputs.values(), batch.inputs, strict=True):
        if names[0] in CONSTANTS:
            inputs.append(values[picture])
        else:
            padded = functional.pad(values, (reach, reach, reach, reach))
            inputs.append(padded.permute(0, 2, 3, 1)[picture[:, None, None], rows, columns].permute(0, 3, 1, 2))
    return Batch(tuple(inputs), batch.truth[picture, :, y, x], torch.ones(len(pixel), device=device))
