"""The interface of networks, for training, validation and export."""

from abc import ABC, abstractmethod
from typing import ClassVar, Literal, NamedTuple

import torch
from torch import Tensor, nn


class IntermediateOutputs(NamedTuple):
    """Intermediate outputs of a network with equation 2 inside, for auxiliary losses."""

    lit: Tensor
    """(N, 3, H, W). Logits of whether each light reaches a pixel."""
    formula: Tensor
    """(N, 3, H, W). Unit vectors: normals by equation 2 alone."""
    own: Tensor
    """(N, 3, H, W). Unit vectors: the network's own normals, without equation 2."""
    trust: Tensor
    """(N, 1, H, W). Logits of the weight of equation 2 in the output."""


class Prediction(NamedTuple):
    """The output of a network."""

    normals: Tensor
    """(N, 3, H, W), or (N, 3) for patches. Unit vectors in the network's frame."""
    expected_error: Tensor | None = None
    """(N, 1, H, W). Predicted angular error in radians; None if the network predicts none."""
    intermediate: IntermediateOutputs | None = None
    """Intermediate outputs, in training mode only, of networks with equation 2 inside."""


class Network(nn.Module, ABC):
    """Abstract class of all networks.

    Attributes
    ----------
    inputs : dict of str to tuple of str
        The feature maps stacked into each argument of :meth:`forward`
        (:data:`mpsnet_core.estimate.features.FEATURE_CHANNELS`).
    kind, frame, magnified, multiple, halo, patch
        As on the card (:class:`mpsnet_core.estimate.card.ModelCard`).
    """

    inputs: ClassVar[dict[str, tuple[str, ...]]]
    kind: ClassVar[Literal["dense", "patch", "pyramid"]] = "dense"
    frame: ClassVar[Literal["camera", "canonical"]] = "camera"
    magnified: float = 1.0
    multiple: int = 1
    halo: int = 0
    patch: int = 1

    @abstractmethod
    def forward(self, *inputs: Tensor) -> Prediction:
        """Normals from the inputs, (N, C, H, W) each, in the order of `inputs`. "lights" is (N, 9, 1, 1)."""


def unit(vectors: Tensor) -> Tensor:
    """Normalise vectors along axis 1; zero stays zero."""
    # In single precision, even if the layers before run in bfloat16.
    vectors = vectors.float()
    return vectors * torch.rsqrt((vectors * vectors).sum(dim=1, keepdim=True) + 1e-12)


def inverse(lights: Tensor) -> Tensor:
    """(N, 3, 3) inverses of light directions (N, 9, 1, 1), by cross products: ONNX has no matrix inverse."""
    first, second, third = lights.flatten(1).reshape(-1, 3, 3).unbind(dim=1)
    columns = [torch.linalg.cross(*pair) for pair in ((second, third), (third, first), (first, second))]
    volume = (first * columns[0]).sum(dim=1)[:, None, None]
    # Lights in one plane determine no normal; keep the division finite.
    volume = torch.where(volume.abs() < 1e-6, torch.full_like(volume, 1e-6), volume)
    return torch.stack(columns, dim=2) / volume


def apply_matrix(matrix: Tensor, pixels: Tensor) -> Tensor:
    """Each pixel of (N, 3, H, W) multiplied by a matrix (N, 3, 3), in the matrix's precision."""
    with torch.autocast(pixels.device.type, enabled=False):
        return torch.matmul(matrix, pixels.to(matrix.dtype).flatten(2)).reshape(pixels.shape)


def scaled(maps: tuple[int, ...], width: float) -> list[int]:
    """Published numbers of maps times `width`, at least one. Raises ValueError if the width is invalid."""
    if isinstance(width, bool) or not isinstance(width, int | float) or not 0 < width <= 4:
        raise ValueError(f"width {width!r} is not a number above 0 and up to 4")
    return [max(1, round(count * width)) for count in maps]


def convolution(
    channels: int, maps: int, side: int = 3, *, stride: int = 1, padding: int | None = None, bias: bool = True
) -> nn.Conv2d:
    """A convolution, by default zero-padded to keep the size (the paper's SAME)."""
    padding = side // 2 if padding is None else padding
    return nn.Conv2d(channels, maps, side, stride, padding, bias=bias)
