"""JPEG compression artefacts, simulated for a batch of images without writing files.

ITU-T T.81 with its example quantisation tables (annex K), scaled by quality as in libjpeg, and JFIF's colour space.
Entropy coding is lossless and left out.
"""

import math

import torch
from torch import Tensor
from torch.nn import functional

_LUMINANCE = torch.tensor(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ],
    dtype=torch.float32,
)
_CHROMINANCE = torch.full((8, 8), 99.0)
_CHROMINANCE[:4, :4] = torch.tensor([[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]])
_FREQUENCY, _PLACE = torch.meshgrid(torch.arange(8), torch.arange(8), indexing="ij")
_DCT = torch.cos((2 * _PLACE + 1) * _FREQUENCY * math.pi / 16) * torch.where(_FREQUENCY == 0, math.sqrt(1 / 8), 0.5)


def jpeg_losses(levels: Tensor, quality: Tensor, halved_chroma: Tensor) -> Tensor:
    """8-bit images after JPEG compression.

    levels: (N, 3, H, W) R, G, B, integers 0 to 255; H and W multiples of 16. quality: (N,) libjpeg's, 1 to 100.
    halved_chroma: (N,) bool, whether to subsample chroma (4:2:0 instead of 4:4:4).
    """
    red, green, blue = levels.unbind(1)
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    chroma = torch.stack([(blue - luma) / 1.772, (red - luma) / 1.402], dim=1)
    for which in (False, True):
        some = torch.nonzero(halved_chroma == which).flatten()
        if len(some):
            chroma[some] = _halved(chroma[some], quality[some]) if which else _chroma(chroma[some], quality[some])
    luma = _quantised(torch.round(luma)[:, None] - 128, _LUMINANCE, quality)[:, 0] + 128
    red, blue = luma + 1.402 * chroma[:, 1], luma + 1.772 * chroma[:, 0]
    green = (luma - 0.299 * red - 0.114 * blue) / 0.587
    return torch.round(torch.stack([red, green, blue], dim=1)).clamp(0, 255)


def _chroma(chroma: Tensor, quality: Tensor) -> Tensor:
    return _quantised(torch.round(chroma), _CHROMINANCE, quality)


def _halved(chroma: Tensor, quality: Tensor) -> Tensor:
    half = _chroma(functional.avg_pool2d(chroma, 2), quality)
    return torch.round(functional.interpolate(half, scale_factor=2, mode="bilinear", align_corners=False))


def _quantised(planes: Tensor, table: Tensor, quality: Tensor) -> Tensor:
    """Planes (N, C, H, W), centred on 0, after DCT, quantisation and inverse DCT of their 8 x 8 blocks."""
    scale = torch.where(quality < 50, torch.floor(5000 / quality), 200 - 2 * quality)[:, None, None]
    table, transform = table.to(planes.device), _DCT.to(planes.device)
    steps = torch.floor((table * scale + 50) / 100).clamp(1, 255)[:, None, :, None]
    # Transform along rows, then along columns, without copying blocks together.
    rows = (len(planes), -1, 8, planes.shape[3])
    columns = (*rows[:3], planes.shape[3] // 8, 8)
    coefficients = (transform @ planes.reshape(rows)).reshape(columns) @ transform.T
    coefficients = torch.round(coefficients / steps) * steps
    restored = transform.T @ (coefficients @ transform).reshape(rows)
    return torch.round(restored).reshape(planes.shape).clamp(-128, 127)
