"""MPS-Net's patch-wise form as it is exported: the same answers with a quarter of the multiply-adds.

From conv4 on, overlapping patches share no values (see :mod:`.mps_net`), so the work per patch must shrink. A 3 x 3
convolution of a 5 x 5 patch, zero-padded, is a cyclic one of 6 x 6 values, because one row and one column of zeros are
padding on both sides. So it is a product in the Fourier domain. Of its 36 frequencies, four are real; the others are 16
complex ones and their conjugates. With three real products for a complex one (Gauss), that takes 52 products for each
pair of channels. A plain convolution takes 225, and 169 without those of the padding. With stride 2, three outputs an
axis take six products (Karatsuba), so both axes take 36 instead of 81.

The patches of a batch share the weights, so this is 52 matrix products with the weights of all channels. To and from
the Fourier domain it is a matrix product, too. For a network of published width:

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
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.learning.training.networks.mps_net import MpsNet
from mpsnet_core.learning.training.networks.network import Network, Prediction, unit

SIDE = 5
_MATRICES = ("forth", "weigh", "back", "one")


class _Algorithm(NamedTuple):
    """outputs = back @ ((weigh @ weights) * (forth @ values)), with as many products as rows."""

    forth: NDArray[np.float64]  # (products, values)
    weigh: NDArray[np.float64]  # (products, weights)
    back: NDArray[np.float64]  # (outputs, products)


def _convolution() -> _Algorithm:
    """3 x 3 weights over 5 x 5 values, zero-padded, in the Fourier domain of 6 x 6 values."""
    size = SIDE + 1
    fourier = np.fft.fft(np.eye(size))
    values, weights = fourier[:, :SIDE], fourier[:, [1, 0, -1]]  # the middle weight stands at the origin
    values, weights = np.kron(values, values), np.kron(weights, weights)
    forth: list[NDArray[np.float64]] = []
    weigh: list[NDArray[np.float64]] = []
    back: list[NDArray[np.float64]] = []
    for number, (x, w) in enumerate(zip(values, weights, strict=True)):
        row, column = divmod(number, size)
        conjugate = -row % size * size + -column % size
        share = (1 + (conjugate != number)) / size**2
        if conjugate == number:
            forth, weigh, back = [*forth, x.real], [*weigh, w.real], [*back, share * x.real]
        elif number < conjugate:
            forth += [x.real + x.imag, x.real, x.imag]
            weigh += [w.real, w.imag - w.real, w.real + w.imag]
            back += [share * (x.real + x.imag), share * x.imag, -share * x.real]
    return _Algorithm(np.stack(forth), np.stack(weigh), np.stack(back, axis=1))


def _convolution_of_stride_2() -> _Algorithm:
    """The same, but only every second output. Along an axis, the first, third and fifth take six products."""
    values, (left, middle, right) = np.eye(SIDE), np.eye(3)
    axis = (
        np.stack([*values[::2], values[1], values[3], values[1] + values[3]]),
        np.stack([middle, middle, middle, right, left, left + right]),
        np.array([[1, 0, 0, 1, 0, 0], [0, 1, 0, -1, -1, 1], [0, 0, 1, 0, 1, 0]], float),
    )
    return _Algorithm(*(np.kron(matrix, matrix) for matrix in axis))


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
        for stride, algorithm in ((1, _convolution()), (2, _convolution_of_stride_2())):
            # Added to the products, this adds 1 to all outputs.
            one = np.linalg.lstsq(algorithm.back, np.ones(len(algorithm.back)), rcond=None)[0]
            for name, matrix in zip(_MATRICES, (*algorithm, one), strict=True):
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
