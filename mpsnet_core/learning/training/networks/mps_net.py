"""MPS-Net: Ju et al., "MPS-Net: Learning to recover surface normal for multispectral photometric stereo" (2019).

Section 3 and figure 3 of the paper leave some details open. Our choices:

* *Image and normal features concatenated*: conv2's maps and the three components of the initial normals. The only other
  layer that sees the initial normals is the shortcut conv8.
* *Permutation of conv2's maps*: none. A fixed permutation changes nothing, because the maps are learned. A new one in
  each training step would hide from all later layers which light a map belongs to: without initial normals, on samples
  of one rig, 250 steps then end at 39 degrees instead of 17.
* *Dropout* has rate 0.1 and acts on single values, not on whole maps, because a cast shadow hides single places.
* *Batch norm* comes before ELU, after conv3 to conv7 and conv9 ("except on the first two"; conv8 is only added, conv10
  is the output).
* *Shortcut added* to conv7's maps, after their ELU.

In the patch-wise form, SAME padding sees zeros beyond each patch, where overlapping patches would see neighbours. So
overlapping patches share only the 1 x 1 layers (conv1, conv2, conv8) and conv3, which has nine variants, one for each
way in which the patch's edge cuts its 3 x 3 window. From conv4 on, the values at all 25 places differ. Sharing those
values would save 0.03 of 0.72 × 10⁹ multiply-adds per patch (4%), and sharing conv4's products with conv3's nine
variants, too, another 6%. So patches are computed one by one.
"""

import torch
from torch import Tensor, nn

from mpsnet_core.learning.training.networks.network import Network, Prediction, convolution, scaled, unit

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
