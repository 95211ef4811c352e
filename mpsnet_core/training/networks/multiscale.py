"""Multiscale: our own network, the default.

A U-Net over five scales, from the photo's own pixels to a sixteenth. What it stands on:

* *Canonical frame*: the picture is turned, before the network sees it, so that the first light stands straight up and
  the lights run counter-clockwise. The network learns one arrangement instead of all, and turning the scene turns the
  answer by construction.
* *Grey world*: it sees each channel divided by its own mean, and equation 2 on that. Exposure, the lights' strengths,
  and the object's overall colour therefore cannot change the answer.
* *Logarithms*: a surface's colour is a factor of all that is seen, in logarithms an offset, which convolutions remove.
* *Light directions* scale and shift the maps where each scale begins (Perez et al., "FiLM", AAAI 2018).
* *Expected error*: a second output, learned as the mean of the angular error (squared loss).
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.training.networks.network import Network, Prediction, convolution, unit

# Added to grey-world values before their logarithm: shadows of a 30th of the mean are as good as black.
DARKEST = 0.03
SEEN = 7  # channels of "pixels"
FINE_MAPS = 9


class Multiscale(Network):
    """widths: maps at a half, a quarter, an eighth and a sixteenth of the photo's resolution."""

    inputs = {"pixels": ("grey_world", "initial_normals_grey_world", "mask"), "lights": ("lights",)}
    frame = "canonical"
    multiple = 16
    halo = 144

    def __init__(self, widths: Sequence[int] = (32, 64, 128, 152)) -> None:
        super().__init__()
        numbers = isinstance(widths, list | tuple) and all(type(maps) is int and 1 <= maps <= 4096 for maps in widths)
        if not numbers or len(widths) != 4:
            raise ValueError(f"widths {widths!r} are not four whole numbers from 1 to 4096")
        half, quarter, eighth, sixteenth = widths
        self.lights = nn.Sequential(convolution(9, 64, 1), nn.ReLU())
        self.down1 = _Down(SEEN, half, side=4)
        self.down2 = _Down(half, quarter)
        self.down3 = _Down(quarter, eighth)
        self.down4 = _Down(eighth, sixteenth)
        self.bottom = _Residual(sixteenth)
        self.up4 = _Up(sixteenth, eighth)
        self.up3 = _Up(eighth, quarter)
        self.up2 = _Up(quarter, half)
        self.fine = nn.Sequential(convolution(half, 4 * FINE_MAPS, 1), nn.PixelShuffle(2))
        self.joined = nn.Sequential(convolution(FINE_MAPS + SEEN, 16, bias=False), nn.BatchNorm2d(16), nn.ReLU())
        self.answer = convolution(16, 4)
        with torch.no_grad():
            self.answer.get_parameter("bias")[3] = -2.0  # 7 degrees by softplus: of the right size from the start

    def predict(self, *inputs: Tensor) -> Prediction:
        pixels, lights = inputs
        grey_world, initial, mask = pixels[:, 0:3], pixels[:, 3:6], pixels[:, 6:7]
        seen = torch.cat([0.5 * torch.log(grey_world.clamp(min=0) + DARKEST) * mask, initial, mask], dim=1)
        told = self.lights(lights)
        scale2 = self.down1(seen, told)
        scale4 = self.down2(scale2, told)
        scale8 = self.down3(scale4, told)
        scale16 = self.bottom(self.down4(scale8, told))
        maps = self.up2(self.up3(self.up4(scale16, scale8), scale4), scale2)
        maps = self.joined(torch.cat([self.fine(maps), seen], dim=1))
        answer = self.answer(maps).float()
        return Prediction(unit(initial + answer[:, 0:3]), functional.softplus(answer[:, 3:4]))


class _Residual(nn.Module):
    def __init__(self, maps: int) -> None:
        super().__init__()
        self.first = nn.Sequential(convolution(maps, maps, bias=False), nn.BatchNorm2d(maps), nn.ReLU())
        self.second = nn.Sequential(convolution(maps, maps, bias=False), nn.BatchNorm2d(maps))

    def forward(self, maps: Tensor) -> Tensor:
        return functional.relu(maps + self.second(self.first(maps)))


class _Down(nn.Module):
    """To half the resolution; the lights scale and shift what comes out."""

    def __init__(self, channels: int, maps: int, side: int = 2) -> None:
        super().__init__()
        self.shrink = nn.Sequential(
            convolution(channels, maps, side, stride=2, padding=side // 2 - 1, bias=False), nn.BatchNorm2d(maps)
        )
        self.told = convolution(64, 2 * maps, 1)
        self.residual = _Residual(maps)

    def forward(self, maps: Tensor, told: Tensor) -> Tensor:
        scale, shift = self.told(told).chunk(2, dim=1)
        return self.residual(functional.relu(self.shrink(maps) * (1 + scale) + shift))


class _Up(nn.Module):
    """To twice the resolution, joined with what was there on the way down."""

    def __init__(self, channels: int, maps: int) -> None:
        super().__init__()
        self.grow = nn.Sequential(convolution(channels, 4 * maps, 1), nn.PixelShuffle(2))
        self.residual = _Residual(maps)

    def forward(self, maps: Tensor, beside: Tensor) -> Tensor:
        return self.residual(functional.relu(self.grow(maps) + beside))
