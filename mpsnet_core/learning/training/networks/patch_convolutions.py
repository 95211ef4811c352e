"""Convolutions of 5 x 5 patches with a quarter of the multiply-adds, as matrix products.

A 3 x 3 convolution of a 5 x 5 patch, zero-padded, is a cyclic one of 6 x 6 values, because one row and one column of
zeros are padding on both sides. So it is a product in the Fourier domain. Of its 36 frequencies, four are real; the
others are 16 complex ones and their conjugates. With three real products for a complex one (Gauss), that takes 52
products for each pair of channels. A plain convolution takes 225, and 169 without those of the padding. With stride 2,
three outputs an axis take six products (Karatsuba), so both axes take 36 instead of 81.

The patches of a batch share the weights, so this is 52 matrix products with the weights of all channels. To and from
the Fourier domain it is a matrix product, too.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

SIDE = 5


class BilinearAlgorithm(NamedTuple):
    """outputs = back @ ((weigh @ weights) * (forth @ values)), with as many products as rows."""

    forth: NDArray[np.float64]  # (products, values)
    weigh: NDArray[np.float64]  # (products, weights)
    back: NDArray[np.float64]  # (outputs, products)


def algorithm() -> BilinearAlgorithm:
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
    return BilinearAlgorithm(np.stack(forth), np.stack(weigh), np.stack(back, axis=1))


def strided_algorithm() -> BilinearAlgorithm:
    """The same, but only every second output. Along an axis, the first, third and fifth take six products."""
    values, (left, middle, right) = np.eye(SIDE), np.eye(3)
    axis = (
        np.stack([*values[::2], values[1], values[3], values[1] + values[3]]),
        np.stack([middle, middle, middle, right, left, left + right]),
        np.array([[1, 0, 0, 1, 0, 0], [0, 1, 0, -1, -1, 1], [0, 0, 1, 0, 1, 0]], float),
    )
    return BilinearAlgorithm(*(np.kron(matrix, matrix) for matrix in axis))


@lru_cache(maxsize=2)
def _matrices(stride: int) -> tuple[Tensor, Tensor, Tensor]:
    forth, weigh, back = strided_algorithm() if stride == 2 else algorithm()
    return torch.from_numpy(forth).float(), torch.from_numpy(weigh).float(), torch.from_numpy(back).float()


def convolve_patches(values: Tensor, weight: Tensor, stride: int = 1) -> Tensor:
    """Zero-padded 3 x 3 convolution of patches (25, N, C) by weights (M, C, 3, 3), without bias.

    Patches are stored place by place, row by row. Returns (25, N, M), or (9, N, M) with stride 2. In single precision,
    on the CPU; half precision loses too much in the Fourier domain.
    """
    forth, weigh, back = _matrices(stride)
    products, (_, count, channels), maps = len(forth), values.shape, len(weight)
    weights = (weigh @ weight.reshape(-1, 9).T).view(products, maps, channels).transpose(1, 2)
    seen = (forth @ values.flatten(1)).view(products, count, channels)
    return (back @ torch.bmm(seen, weights).flatten(1)).view(len(back), count, maps)
