"""Demultiplexer: Ju et al., "Demultiplexing colored images for multispectral photometric stereo via deep neural
networks" (IEEE Access 6, 2018): a network separates a mixed pixel into three intensities, then equation 2.

Layers and widths are our choice. Two more differences from the paper: the light directions are an input, because our
rigs differ from photo to photo, and the loss is on the normals, with gradients through equation 2.
"""

from torch import Tensor, nn

from mpsnet_core.learning.training.networks.network import (
    Network,
    Prediction,
    apply_matrix,
    convolution,
    inverse,
    scaled,
    unit,
)


class Demultiplexer(Network):
    """A network of 1 x 1 convolutions. width: factor of the numbers of maps (64, 128, 128, 64)."""

    inputs = {"photo": ("photo",), "lights": ("lights",)}

    def __init__(self, width: float = 1.0) -> None:
        super().__init__()
        first, second, third, fourth = scaled((64, 128, 128, 64), width)
        self.photo = convolution(3, first, 1)
        self.lights = convolution(9, first, 1)
        self.layers = nn.Sequential(
            nn.ELU(),
            convolution(first, second, 1),
            nn.ELU(),
            convolution(second, third, 1),
            nn.ELU(),
            convolution(third, fourth, 1),
            nn.ELU(),
            convolution(fourth, 3, 1),
        )

    def forward(self, *inputs: Tensor) -> Prediction:
        photo, lights = inputs
        # The network predicts a residual: before training, the three intensities are the pixel's channels.
        intensities = photo + self.layers(self.photo(photo) + self.lights(lights))
        return Prediction(unit(apply_matrix(inverse(lights), intensities)))
