"""MPS-Net's patch-wise form as it is exported: the same answers with a quarter of the multiply-adds.

From conv4 on, overlapping patches share no values (see :mod:`.mps_net`), so the work per patch must shrink, see
:mod:`.patch_convolutions`. For a network of published width:

=====================================  =============
multiply-adds a patch                    in millions
=====================================  =============
layers as they stand                             723
without those of the padding                     537
52 and 36 products, and other layers             177
to and from the Fourier domain                    11
=====================================  =============
"""

import copy

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.learning.training.networks.mps_net import MpsNet
from mpsnet_core.learning.training.networks.network import Network, Prediction, unit
from mpsnet_core.learning.training.networks.patch_convolutions import SIDE, algorithm, strided_algorithm

_MATRICES = ("forth", "weigh", "back", "one")


class FastPatches(Network):
    """What :class:`MpsNet` computes for patches of side 5. Its convolutions' weights are kept as half floats.

    network: as :func:`folded_to_half_floats` returns it.
    """

    inputs = MpsNet.inputs
    kind = "patch"
    patch = SIDE

    def __init__(self, network: MpsNet) -> None:
        super().__init__()
        for name, module in network.named_modules():
            if isinstance(module, nn.Conv2d):
                assert module.bias is not None
                name = name.partition(".")[0]  # conv3 and others are a sequence with their batch norm
                self.register_buffer(f"{name}_weight", module.weight.detach().half())
                self.register_buffer(f"{name}_bias", module.bias.detach().clone())
        self.normals = network.conv8 is not None
        for stride, bilinear in ((1, algorithm()), (2, strided_algorithm())):
            # Added to the products, this adds 1 to all outputs.
            one = np.linalg.lstsq(bilinear.back, np.ones(len(bilinear.back)), rcond=None)[0]
            for name, matrix in zip(_MATRICES, (*bilinear, one), strict=True):
                self.register_buffer(f"{name}_{stride}", torch.from_numpy(matrix).float())

    def forward(self, *inputs: Tensor) -> Prediction:
        """Normals (N, 3) of patches (N, 3, 5, 5). Within, values are places x maps x patches."""
        photo, initial_normals = (values.permute(2, 3, 1, 0).flatten(0, 1) for values in inputs)
        maps = _elu(self._pixels("conv2", _elu(self._pixels("conv1", photo))))
        if self.normals:
            maps = torch.cat([maps, initial_normals], dim=1)
        for layer in ("conv3", "conv4", "conv5", "conv6", "conv7"):
            maps = _elu(self._convolved(layer, maps))
        if self.normals:
            maps = maps + self._pixels("conv8", initial_normals)
        maps = _elu(self._convolved("conv9", maps, stride=2))
        weight, bias = self._layer("conv10")
        return Prediction(unit((weight.permute(0, 2, 3, 1).flatten(1) @ maps.flatten(0, 1) + bias[:, None]).T))

    def _layer(self, name: str) -> tuple[Tensor, Tensor]:
        return getattr(self, f"{name}_weight").float(), getattr(self, f"{name}_bias")

    def _pixels(self, name: str, values: Tensor) -> Tensor:
        """A convolution of side 1."""
        weight, bias = self._layer(name)
        result: Tensor = weight.flatten(1) @ values + bias[:, None]
        return result

    def _convolved(self, name: str, values: Tensor, stride: int = 1) -> Tensor:
        weight, bias = self._layer(name)
        maps, channels = weight.shape[:2]
        forth, weigh, back, one = (getattr(self, f"{matrix}_{stride}") for matrix in _MATRICES)
        count = len(forth)
        # One group for each product. onnxruntime computes these weights once, when it opens the file.
        weights = (weight.flatten(2) @ weigh.T).permute(2, 0, 1).reshape(count * maps, channels, 1)
        seen = (forth @ values.flatten(1)).reshape(1, count * channels, -1)
        products = functional.conv1d(seen, weights, (one[:, None] * bias).flatten(), groups=count)
        result: Tensor = (back @ products.reshape(count, -1)).reshape(len(back), maps, -1)
        return result


def _elu(values: Tensor) -> Tensor:
    """ELU. onnxruntime's own takes twice as long."""
    return torch.maximum(values, torch.exp(torch.minimum(values, torch.zeros(()))) - 1)


def folded_to_half_floats(network: MpsNet) -> MpsNet:
    """A copy for inference: batch norms folded into the convolutions before them, then weights rounded to half floats.

    The rounding changes normals by hundredths of a degree.
    """
    network = copy.deepcopy(network).eval()
    for module in network.modules():
        if isinstance(module, nn.Sequential):
            layer, norm, _ = module
            assert isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
            module[0], module[1] = nn.utils.fusion.fuse_conv_bn_eval(layer, norm), nn.Identity()
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.data = module.weight.detach().half().float()
    return network
