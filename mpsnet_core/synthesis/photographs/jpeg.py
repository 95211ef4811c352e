"""What JPEG compression does to a picture, computed and not written: the same on every machine, whatever its libjpeg.

ITU-T T.81 with its example quantisation tables (annex K), scaled by quality as libjpeg scales them, and JFIF's colours.
Entropy coding loses nothing and is left out.
"""

import numpy as np
from numpy.typing import NDArray

_LUMINANCE = np.array(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ]
)
_CHROMINANCE = np.full((8, 8), 99)
_CHROMINANCE[:4, :4] = [[17, 18, 24, 47], [18, 21, 26, 66], [24, 26, 56, 99], [47, 66, 99, 99]]

_FREQUENCY, _PLACE = np.meshgrid(np.arange(8), np.arange(8), indexing="ij")
_DCT = np.cos((2 * _PLACE + 1) * _FREQUENCY * np.pi / 16) * np.where(_FREQUENCY == 0, np.sqrt(1 / 8), 0.5)


def jpeg_losses(levels: NDArray[np.float64], quality: int, *, halved_chroma: bool = True) -> NDArray[np.float64]:
    """An 8-bit picture after it was stored as JPEG.

    levels: (H, W, 3) whole numbers 0 to 255, R, G, B. quality: 1 to 100, libjpeg's. halved_chroma: whether colour is
    stored at half the resolution both ways (4:2:0, as phones do), else at the full one (4:4:4). Returns levels again.
    """
    height, width, _ = levels.shape
    planes = np.ascontiguousarray(levels.transpose(2, 0, 1))
    red, green, blue = np.pad(planes, [(0, 0), (0, -height % 16), (0, -width % 16)], mode="edge")
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    chroma = [(blue - luma) / 1.772, (red - luma) / 1.402]
    if halved_chroma:
        chroma = [_rounded(_enlarged(_stored(_halved(plane), _CHROMINANCE, quality))) for plane in chroma]
    else:
        chroma = [_stored(_rounded(plane), _CHROMINANCE, quality) for plane in chroma]
    luma = _stored(_rounded(luma) - 128, _LUMINANCE, quality) + 128
    red, blue = luma + 1.402 * chroma[1], luma + 1.772 * chroma[0]
    green = (luma - 0.299 * red - 0.114 * blue) / 0.587
    decoded = np.stack([red, green, blue])[:, :height, :width].transpose(1, 2, 0)
    return np.clip(_rounded(decoded), 0, 255)


def _stored(plane: NDArray[np.float64], table: NDArray[np.int64], quality: int) -> NDArray[np.float64]:
    """A plane centred on 0 whose blocks of 8 x 8 have gone through the quantised cosine transform and back."""
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    steps = np.clip((table * scale + 50) // 100, 1, 255)
    height, width = plane.shape
    blocks = plane.reshape(height // 8, 8, width // 8, 8).transpose(0, 2, 1, 3)
    kept = _rounded(_DCT @ blocks @ _DCT.T / steps) * steps
    restored = _DCT.T @ kept @ _DCT
    return np.clip(_rounded(restored.transpose(0, 2, 1, 3).reshape(height, width)), -128, 127)


def _halved(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    height, width = plane.shape
    return _rounded(plane.reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)))


def _enlarged(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the size both ways, each pixel three parts its own and one part its neighbour's, as libjpeg does."""
    for _ in range(2):  # rows, then columns
        before, after = np.concatenate([plane[:1], plane[:-1]]), np.concatenate([plane[1:], plane[-1:]])
        rows = np.stack([0.75 * plane + 0.25 * before, 0.75 * plane + 0.25 * after], axis=1)
        plane = rows.reshape(2 * len(plane), -1).T
    return plane


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    # Halves are common here, and which side of them a sum falls on depends on the order of its terms: all go up.
    return np.floor(values + (0.5 + 1e-9))
