"""The networks of the papers."""

import torch
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


# --- MPS-Net: Ju et al., "MPS-Net: Learning to recover surface normal for multispectral photometric stereo" (2019) ----
# Section 3 and figure 3 of the paper leave some details open. Our choices:
#
# * *Image and normal features concatenated*: conv2's maps and the three components of the initial normals. The only
#   other layer that sees the initial normals is the shortcut conv8.
# * *Permutation of conv2's maps*: none. A fixed permutation changes nothing, because the maps are learned. A new one in
#   each training step would hide from all later layers which light a map belongs to: without initial normals, on
#   samples of one rig, 250 steps then end at 39 degrees instead of 17.
# * *Dropout* has rate 0.1 and acts on single values, not on whole maps, because a cast shadow hides single places.
# * *Batch norm* comes before ELU, after conv3 to conv7 and conv9 ("except on the first two"; conv8 is only added,
#   conv10 is the output).
# * *Shortcut added* to conv7's maps, after their ELU.
#
# In the patch-wise form, SAME padding sees zeros beyond each patch, where overlapping patches would see neighbours. So
# overlapping patches share only the 1 x 1 layers (conv1, conv2, conv8) and conv3, which has nine variants, one for each
# way in which the patch's edge cuts its 3 x 3 window. From conv4 on, the values at all 25 places differ. Sharing those
# values would save 0.03 of 0.72 × 10⁹ multiply-adds per patch (4%), and sharing conv4's products with conv3's nine
# variants, too, another 6%. So patches are computed one by one.


DROPOUT = 0.1


class MpsNet(Network):
    """The patch-wise form, as published: one normal for the middle of each patch.

    width: factor of the published numbers of maps. patch: side of a patch, 5 as published; 1, 3, 7 and 9 for the
    paper's table 1, where conv9 halves the side, rounded up, and conv10 covers the result. normals: False omits the
    initial normals and their shortcut (table 1).
    """

    inputs = {"photo": ("photo",), "initial_normals": ("initial_normals",)}
    kind = "patch"

    def __init__(self, width: float = 1.0, patch: int = 5, normals: bool = True) -> None:
        super().__init__()
        if not isinstance(patch, int) or patch % 2 == 0 or not 1 <= patch <= 15:
            raise ValueError(f"patch {patch!r} is not an odd number from 1 to 15")
        self.patch = patch
        small, middle, large = scaled((256, 512, 1024), width)
        self.conv1 = convolution(3, small, 1)
        self.conv2 = convolution(small, small, 1)
        self.conv3 = _normed(small + 3 * normals, middle)
        self.conv4 = _normed(middle, middle)
        self.conv5 = _normed(middle, large)
        self.conv6 = _normed(large, large)
        self.conv7 = _normed(large, large)
        self.conv8 = convolution(3, large, 1) if normals else None
        # On a single pixel the stride does not matter, but oneDNN's bfloat16 gradients of stride 2 are not finite.
        self.conv9 = _normed(large, middle, stride=2 if patch > 1 else 1)
        self.conv10 = convolution(middle, 3, (patch + 1) // 2, padding=0)
        self.dropout = nn.Dropout(DROPOUT)
        self.elu = nn.ELU()

    def forward(self, *inputs: Tensor) -> Prediction:
        photo, initial_normals = inputs
        image = self.elu(self.conv2(self.elu(self.conv1(photo))))
        maps = image if self.conv8 is None else torch.cat([image, initial_normals.to(image.dtype)], dim=1)
        maps = self.conv4(self.dropout(self.conv3(maps)))
        maps = self.conv7(self.conv6(self.dropout(self.conv5(maps))))
        maps = maps if self.conv8 is None else maps + self.conv8(initial_normals)
        return Prediction(unit(self.conv10(self.conv9(maps)).flatten(1)))


def _normed(channels: int, maps: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(convolution(channels, maps, bias=False, stride=stride), nn.BatchNorm2d(maps), nn.ELU())


# --- PS-FCN: Chen et al., "PS-FCN: A flexible learning framework for photometric stereo" (ECCV 2018), for three lights
# Layers and widths are the paper's. An extractor with shared weights sees one image and its light direction, the maps
# of all lights are max-pooled, and a regressor predicts normals. Here an image is one channel of the photo, as in the
# MPS-Net paper's comparison. LeakyReLU has slope 0.1, and there is no batch norm, as in the authors' own model.


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
