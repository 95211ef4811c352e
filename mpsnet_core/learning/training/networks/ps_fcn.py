"""PS-FCN: Chen et al., "PS-FCN: A flexible learning framework for photometric stereo" (ECCV 2018), for three lights.

Layers and widths are the paper's. An extractor with shared weights sees one image and its light direction, the maps of
all lights are max-pooled, and a regressor predicts normals. Here an image is one channel of the photo, as in the
MPS-Net paper's comparison. LeakyReLU has slope 0.1, and there is no batch norm, as in the authors' own model.
"""

import torch
from torch import Tensor, nn

from mpsnet_core.learning.training.networks.network import Network, Prediction, convolution, scaled, unit


class PsFcn(Network):
    """PS-FCN. width: factor of the published numbers of maps."""

    inputs = {"photo": ("photo",), "lights": ("lights",)}
    multiple = 4
    halo = 28

    def __init__(self, width: float = 1.0) -> None:
        super().__init__()
        small, middle, large = scaled((64, 128, 256), width)
        self.extractor = nn.Sequential(
            *_layer(4, small),
            *_layer(small, middle, stride=2),
            *_layer(middle, middle),
            *_layer(middle, large, stride=2),
            *_layer(large, large),
            *_doubled(large, middle),
            *_layer(middle, middle),
        )
        self.regressor = nn.Sequential(
            *_layer(middle, middle),
            *_layer(middle, middle),
            *_layer(middle, middle),
            *_doubled(middle, small),
            convolution(small, 3, bias=False),
        )
        # Without batch norm, activations would shrink from layer to layer with PyTorch's default initialisation.
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.kaiming_normal_(layer.weight, a=0.1, mode="fan_in")

    def forward(self, *inputs: Tensor) -> Prediction:
        photo, lights = inputs
        directions = lights.expand(-1, -1, *photo.shape[2:])
        images = [torch.cat([photo[:, k : k + 1], directions[:, 3 * k : 3 * k + 3]], dim=1) for k in range(3)]
        features = [self.extractor(image) for image in images]
        joined = torch.maximum(torch.maximum(features[0], features[1]), features[2])
        return Prediction(unit(self.regressor(joined)))


def _layer(channels: int, maps: int, stride: int = 1) -> list[nn.Module]:
    return [convolution(channels, maps, stride=stride), nn.LeakyReLU(0.1)]


def _doubled(channels: int, maps: int) -> list[nn.Module]:
    return [nn.ConvTranspose2d(channels, maps, 4, stride=2, padding=1), nn.LeakyReLU(0.1)]
