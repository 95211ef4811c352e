"""Gradients of heights along an image's columns and rows. Unlike normals, they can be added and averaged."""

import numpy as np

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.arrays.unit_vectors import normalised


def periodic_height(gradients: F32, pitch: tuple[float, float]) -> F32:
    """(H, W) heights of mean 0, in the unit of `pitch`, whose gradients are closest to those given.

    gradients: (H, W, 2) along columns and rows (downwards). They are periodic in both directions, as are the heights.
        Their means are ignored: a periodic surface has none.
    pitch: the width and height of a pixel.

    The least-squares solution by Fourier transforms (Frankot and Chellappa 1988, equation 21).
    """
    height, width = gradients.shape[:2]
    across, down = _waves(height, width, pitch)
    spectra = [np.fft.rfft2(gradients[..., axis]) for axis in (0, 1)]
    power = across**2 + down**2
    power[0, 0] = 1  # the mean, which is 0
    spectrum = -1j * (across * spectra[0] + down * spectra[1]) / np.where(power > 0, power, 1)
    spectrum[0, 0] = 0
    return np.fft.irfft2(spectrum, (height, width)).astype(np.float32)


def remove_low_frequencies(values: F32, half_waves: int) -> F32:
    """Periodic images (H, W, C) without waves of up to `half_waves` half waves per tile. The mean is kept.

    For oblique waves, the root of the sum of squares over both axes counts. In gradients, these low frequencies yield
    the greatest heights, and an error of a degree or less is enough to cause them.
    """
    height, width = values.shape[:2]
    across, down = np.fft.rfftfreq(width, 1 / width), np.fft.fftfreq(height, 1 / height)[:, None]
    low = np.hypot(across, down) <= half_waves / 2
    low[0, 0] = False
    high = np.empty_like(values)
    for channel in range(values.shape[2]):
        spectrum = np.fft.rfft2(values[..., channel])
        high[..., channel] = np.fft.irfft2(np.where(low, 0, spectrum), (height, width))
    return high


def _waves(height: int, width: int, pitch: tuple[float, float]) -> tuple[F64, F64]:
    """Wave numbers (radians per unit) along columns (1, W/2 + 1) and rows (H, 1); 0 for the Nyquist frequency of an
    even side, whose gradient at the pixels is 0."""
    across, down = 2 * np.pi * np.fft.rfftfreq(width, pitch[0]), 2 * np.pi * np.fft.fftfreq(height, pitch[1])
    if width % 2 == 0:
        across[-1] = 0
    if height % 2 == 0:
        down[height // 2] = 0
    return across[None].astype(np.float64, copy=False), down[:, None].astype(np.float64, copy=False)


# The tangent of 79°. Steeper surfaces are hardly visible, and one such pixel would dominate a mean. Means here are
# unweighted, so this limit is lower than that of integration (gradients.MIN_FACING, 87°), where steep pixels have
# less weight.
STEEPEST = 5.0


def gradients_of(normals: F32) -> F32:
    """(..., 2) height per length to the right and downwards, from normals (..., 3), limited to STEEPEST."""
    facing = np.maximum(normals[..., 2:], 1 / STEEPEST)
    gradients = normals[..., :2] / facing * np.array([-1, 1], np.float32)
    steep = np.maximum(np.linalg.norm(gradients, axis=-1, keepdims=True) / STEEPEST, 1)
    return (gradients / steep).astype(np.float32)


def normals_of(gradients: F32) -> F32:
    """(..., 3) unit normals, x right, y up, z towards the camera, from gradients (..., 2) of :func:`gradients_of`."""
    columns, rows = np.moveaxis(gradients, -1, 0)
    return normalised(np.stack([-columns, rows, np.ones_like(rows)], axis=-1).astype(np.float32))
