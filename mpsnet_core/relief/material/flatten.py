"""Removal of what does not belong to a material: the photo's tilt, large bends of the cloth, uneven light."""

from typing import Any

import numpy as np

from mpsnet_core.arrays.block_means import block_means
from mpsnet_core.arrays.types import F32, F64, I64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.relief.material.gradients import gradients_of

# Block means per side that a smooth polynomial is fitted to; every pixel would not be more exact.
FITTED = 128
# Weight in the fit at the image's edge; 1 at its centre.
MIN_WEIGHT = 0.03

_legvander: Any = np.polynomial.legendre.legvander  # untyped


def flatten_normals(normals: F32, bend: int) -> tuple[F32, float]:
    """Gradients (H, W, 2) of the flattened surface, and its tilt in degrees.

    normals: (H, W, 3) unit vectors in camera space. The mean normal is rotated to +z. Then large bends are subtracted
    from the gradients: their :func:`trend` with up to `bend` half waves across the image.
    """
    rows, columns = (_window(side, 1) for side in normals.shape[:2])
    mean = normalised(np.einsum("hwc,h,w->c", normals, rows, columns, optimize=True))
    turned = normals @ _turn_to_z(mean).T.astype(np.float32)
    gradients = gradients_of(turned)
    return gradients - trend(gradients, bend), float(np.degrees(np.arctan2(np.hypot(*mean[:2]), mean[2])))


def flatten_albedo(albedo: F32, bend: int) -> F32:
    """The albedo (H, W, 3) without low-frequency changes across the image. Each channel keeps its geometric mean."""
    logarithm = np.log(np.maximum(albedo, 1e-4))
    smooth = trend(logarithm, bend)
    return np.exp(logarithm - smooth + smooth.mean(axis=(0, 1)))


def trend(values: F32, degree: int) -> F32:
    """(H, W, C) the polynomial of total `degree` that fits values (H, W, C) best, by weighted least squares.

    A polynomial of degree n crosses zero at most n times across the image: it follows n half waves. Legendre
    polynomials keep the fit well conditioned.
    """
    height, width, channels = values.shape
    factor = max(1, max(height, width) // FITTED)
    small = block_means(values, factor)
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    rows, columns = (_legvander(2 * _middles(side, factor) / side - 1, degree) for side in (height, width))
    basis = np.stack([np.outer(rows[:, i], columns[:, j]).ravel() for i, j in powers], axis=1)
    weight = np.sqrt(np.outer(_window(height, factor), _window(width, factor))).reshape(-1, 1)
    fitted = np.linalg.lstsq(weight * basis, weight * small.reshape(-1, channels), rcond=None)[0]
    weights = np.zeros((degree + 1, degree + 1, channels))
    for (i, j), weight in zip(powers, fitted, strict=True):
        weights[i, j] = weight
    rows, columns = (_legvander(2 * _middles(side, 1) / side - 1, degree) for side in (height, width))
    smooth = np.empty_like(values)
    for channel in range(channels):
        smooth[..., channel] = rows @ weights[..., channel] @ columns.T
    return smooth


def _middles(side: int, factor: int) -> F64:
    """Centres of the blocks along a side, in pixels."""
    return np.arange(0, side, factor) + _sizes(side, factor) / 2


def _window(side: int, factor: int) -> F64:
    """Weight of each block along a side: its number of pixels, reduced towards the ends.

    At the ends a weave is cut off within a period; the remainder would look like a bend.
    """
    window: F64 = MIN_WEIGHT + np.sin(np.pi * _middles(side, factor) / side) ** 2
    return _sizes(side, factor) * window


def _sizes(side: int, factor: int) -> I64:
    """Number of pixels of each block along a side. The last one may be smaller."""
    return np.minimum(factor, side - np.arange(0, side, factor))


def _turn_to_z(unit: F64) -> F64:
    """(3, 3) the shortest rotation of a unit vector with z above 0 to +z (Rodrigues' formula)."""
    x, y, z = unit
    across = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    return np.eye(3) + across + across @ across / (1 + z)
