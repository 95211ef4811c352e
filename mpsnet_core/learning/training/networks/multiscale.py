"""Multiscale: our own network and the default. One network for all scales of a photo, coarse to fine.

It first sees the whole object at low resolution. At each doubling of the resolution, it sees the photo and its own
output on the previous scale, like the multi-scale networks of Ikehata ("Scalable, detailed and mask-free universal
photometric stereo", CVPR 2023) and Hardy et al. ("MS-PS", 2023). So every pixel has the context of the whole object,
however large the photo is. On each scale the network is a U-Net over five resolutions. Its design:

* *Canonical frame*: the image is rotated by quarter turns until the first light is nearly straight up, and the lights
  are ordered counter-clockwise. The network learns one arrangement instead of all.
* *Two versions of the photo*: with each channel divided by its own mean (grey world), which removes exposure, the
  lights' strengths and the object's overall colour; and as calibrated, where equation 2 is exact on anything grey. An
  input says whether a white photo made the surface grey.
* *Logarithms*: a surface's colour is a factor of the image, and an offset of its logarithm, which convolutions remove.
* *Equation 2 inside*: the network's own normals predict each channel's shading. The ratio of photo and shading, over
  some 48 pixels, is the surface's colour. The calibrated photo is divided by a learned share of that colour and
  multiplied by predicted gains; equation 2 on it keeps the finest relief. The output is a weighted mean of these
  normals and the network's own. The weight is learned from which of the two is better.
* *Exact rigs*: an input says whether the rig is known exactly, as for a render. Equation 2 is more accurate then.
* *Light directions* scale and shift the maps at the start of each resolution (Perez et al., "FiLM", AAAI 2018).
* *Expected error*: another output, trained by squared loss to predict the mean angular error.
* *Which lights reach* a pixel: an auxiliary output, in training only.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.learning.training.networks.network import (
    IntermediateOutputs,
    Network,
    Prediction,
    apply_matrix,
    convolution,
    inverse,
    unit,
)

# Offset before logarithms: shadows darker than 1/30 of the mean are as good as black.
DARKEST = 0.03
SEEN = 18  # feature maps computed from the inputs
FINE_MAPS, JOINED = 8, 16
ANSWER = [3, 1, 3, 1, 1]  # normals, expected error, gains, weight of the formula, share of the local colour
MAX_GAIN = 2.0  # limit of the log gains
RIG = 15  # light directions, channel means, flags: coarser scale available, white photo, exact rig
CELL = 4  # factor of both steps of averaging: pixels to measure the local colour on, then cells to smooth it over
MIN_EVIDENCE = 0.0003  # with less evidence the local colour counts as grey
SURE = 0.15  # radians; normals with a larger expected error count little for the colour
BRIGHT = 0.25  # brightness relative to a white surface; darker pixels may be in shadow


class Multiscale(Network):
    """The multiscale network. widths: numbers of maps at 1/2, 1/4, 1/8 and 1/16 of the resolution."""

    inputs = {"pixels": ("photo", "mask", "previous"), "rig": ("lights", "channel_means", "given", "exact")}
    kind = "pyramid"
    frame = "canonical"
    multiple = 16
    magnified = 1.68  # the best trade-off of accuracy and time on held-out samples
    halo = 112  # pixels beyond, up to 133, change the output of trained networks by less than 0.01 degrees

    def __init__(self, widths: Sequence[int] = (32, 64, 128, 152)) -> None:
        super().__init__()
        numbers = isinstance(widths, list | tuple) and all(type(maps) is int and 1 <= maps <= 4096 for maps in widths)
        if not numbers or len(widths) != 4:
            raise ValueError(f"widths {widths!r} are not four whole numbers from 1 to 4096")
        half, quarter, eighth, sixteenth = widths
        self.rig = nn.Sequential(convolution(RIG, 64, 1), nn.ReLU())
        self.down1 = _Down(SEEN, half, side=4, residual=False)
        self.down2 = _Down(half, quarter)
        self.down3 = _Down(quarter, eighth)
        self.down4 = _Down(eighth, sixteenth)
        self.bottom = _Residual(sixteenth)
        self.up4 = _Up(sixteenth, eighth)
        self.up3 = _Up(eighth, quarter)
        self.up2 = _Up(quarter, half)
        self.fine = nn.Sequential(convolution(half, 4 * FINE_MAPS, 1), nn.PixelShuffle(2))
        self.joined = _Normed(convolution(FINE_MAPS + SEEN, JOINED, bias=False), nn.BatchNorm2d(JOINED), nn.ReLU())
        self.answer = convolution(JOINED, sum(ANSWER))
        self.lit = convolution(JOINED, 3, 1)
        with torch.no_grad():
            self.answer.get_parameter("bias")[3] = -2.0  # softplus makes it 7 degrees, a good initial expected error
            self.answer.get_parameter("bias")[8] = -2.0

    def forward(self, *inputs: Tensor) -> Prediction:
        pixels, rig = inputs
        photo, mask, previous = pixels[:, 0:3], pixels[:, 3:4], pixels[:, 4:8]
        lights, means, has_previous = rig[:, 0:9], rig[:, 9:12], rig[:, 12:13]
        solve = inverse(lights)
        pseudo = apply_matrix(solve, photo)
        length = (pseudo * pseudo).sum(dim=1, keepdim=True)
        calibrated = pseudo * torch.rsqrt(length + 1e-12)
        # Zero outside the mask, because the photo is.
        grey_world = unit(apply_matrix(solve / means.flatten(1)[:, None], photo))
        size = torch.log(torch.sqrt(length + 1e-12) + DARKEST)
        features = [
            0.5 * mask * _logarithm(photo / means),
            grey_world,
            0.5 * mask * _logarithm(photo),
            calibrated,
            0.5 * mask * size,
            mask,
            previous,
        ]
        rig_maps = self.rig(rig)
        # The fastest memory layouts: pixel by pixel for convolutions, plane by plane for the formulas before and after.
        # Once in the convolutions' precision, which is that of the first one's output.
        seen = torch.cat(features, dim=1).to(rig_maps.dtype, memory_format=torch.channels_last)
        scale2 = self.down1(seen, rig_maps)
        scale4 = self.down2(scale2, rig_maps)
        scale8 = self.down3(scale4, rig_maps)
        scale16 = self.bottom(self.down4(scale8, rig_maps))
        maps = self.up2(self.up3(self.up4(scale16, scale8), scale4), scale2)
        fine = self.fine(maps)
        maps = self.joined(torch.cat([fine, seen], dim=1))
        answer = self.answer(maps)
        # Split, not sliced: the gradient of each slice would be a tensor of all maps.
        change, error, log_gains, trust, share = torch.split(answer.float().contiguous(), ANSWER, dim=1)
        start = previous[:, 0:3] * has_previous + grey_world * (1 - has_previous)
        normals = unit(start + change)
        expected = _softplus(error)
        found = torch.cat([normals, expected], dim=1).detach() * mask
        colour = _local_colour(photo, mask, found, lights)
        gains = MAX_GAIN * torch.tanh(log_gains) - torch.sigmoid(share) * colour
        formula = unit(apply_matrix(solve, photo * torch.exp(gains)))
        mixed = unit(torch.sigmoid(trust) * (formula - normals) + normals)
        intermediate = IntermediateOutputs(self.lit(maps).float(), formula, normals, trust) if self.training else None
        return Prediction(mixed, expected, intermediate)


def _local_colour(photo: Tensor, mask: Tensor, answer: Tensor, lights: Tensor) -> Tensor:
    """(N, 3, H, W) logarithm of the surface's colour around each pixel, given normals.

    A least-squares fit of each channel to the normals' shading, over some 48 pixels, weighted by confidence. The mean
    over the channels is subtracted. Dark pixels count little: a light may not reach them. answer: (N, 4, H, W) normals
    and expected error, zero outside the mask.
    """
    photo, mask, answer = (functional.avg_pool2d(values.float(), CELL) for values in (photo, mask, answer))
    photo, answer = (photo / mask.clamp(min=1e-3)).clamp(min=0), answer / mask.clamp(min=1e-3)
    shading = apply_matrix(lights.flatten(1).reshape(-1, 3, 3), answer[:, 0:3]).clamp(min=0)
    sure = mask / (1 + (answer[:, 3:4] / SURE) ** 2)
    weight = sure * photo / (photo + BRIGHT)
    found = torch.cat([weight * photo * shading, weight * shading * shading], dim=1)
    found = functional.avg_pool2d(functional.avg_pool2d(found, CELL), 3, 1, 1) + MIN_EVIDENCE
    colour = torch.log(found[:, 0:3]) - torch.log(found[:, 3:6])
    colour = (colour - colour.mean(dim=1, keepdim=True)).clamp(-2, 2)
    return functional.interpolate(colour, scale_factor=CELL * CELL, mode="bilinear", align_corners=False)


def _logarithm(values: Tensor) -> Tensor:
    return torch.log(values.clamp(min=0) + DARKEST)


def _softplus(values: Tensor) -> Tensor:
    # onnxruntime's Softplus is ten times slower than these two operators.
    return -torch.log(torch.sigmoid(-values).clamp(min=1e-30))


class _Normed(nn.Sequential):
    """A convolution, its batch norm, and ReLU where it is given.

    In training, a frozen norm is folded into the filters, which saves a pass over the maps, forward and back.
    """

    def forward(self, maps: Tensor) -> Tensor:
        layer, norm, *rest = self
        if self.training and not norm.training:
            assert isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
            scale = norm.weight * torch.rsqrt(norm.get_buffer("running_var") + norm.eps)
            shift = norm.bias - norm.get_buffer("running_mean") * scale
            maps = layer._conv_forward(maps, layer.weight * scale[:, None, None, None], shift)
            return functional.relu(maps) if rest else maps
        for part in self:
            maps = part(maps)
        return maps


class _Residual(nn.Module):
    def __init__(self, maps: int) -> None:
        super().__init__()
        self.first = _Normed(convolution(maps, maps, bias=False), nn.BatchNorm2d(maps), nn.ReLU())
        self.second = _Normed(convolution(maps, maps, bias=False), nn.BatchNorm2d(maps))

    def forward(self, maps: Tensor) -> Tensor:
        return functional.relu(maps + self.second(self.first(maps)))


class _Down(nn.Module):
    """Downsample by 2, then scale and shift the maps by the rig (FiLM)."""

    def __init__(self, channels: int, maps: int, side: int = 2, residual: bool = True) -> None:
        super().__init__()
        self.shrink = _Normed(
            convolution(channels, maps, side, stride=2, padding=side // 2 - 1, bias=False), nn.BatchNorm2d(maps)
        )
        self.told = convolution(64, 2 * maps, 1)  # scale and shift from the rig; the name is part of checkpoints
        self.residual = _Residual(maps) if residual else nn.Identity()

    def forward(self, maps: Tensor, rig: Tensor) -> Tensor:
        scale, shift = self.told(rig).chunk(2, dim=1)
        return self.residual(functional.relu(self.shrink(maps) * (1 + scale) + shift))


class _Up(nn.Module):
    """Upsample by 2 and add the skip connection."""

    def __init__(self, channels: int, maps: int) -> None:
        super().__init__()
        self.grow = nn.Sequential(convolution(channels, 4 * maps, 1), nn.PixelShuffle(2))
        self.residual = _Residual(maps)

    def forward(self, maps: Tensor, beside: Tensor) -> Tensor:
        return self.residual(functional.relu(self.grow(maps) + beside))
