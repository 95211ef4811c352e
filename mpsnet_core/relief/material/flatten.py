"""Gradients of heights along an image's columns and rows. Unlike normals, they can be added and averaged."""

from typing import Any

import numpy as np

from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import convert_to_distant_lights
from mpsnet_core.estimate.estimator import usable_channels


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


# ----------------------------------------------------------------------------------------------------------------------
# Albedo: the fraction of each light's colour that the surface reflects, once its shape is known.


# Cosines between surface normal and light at which the light's albedo starts to count, and counts fully.
GRAZING, FULL = 0.1, 0.3


def estimated_albedo(capture: Capture, normals: F32, *, grey: bool = False) -> F32:
    """(H, W, 3) the albedo of a matt surface, ``c_i / (n·l_i)``, as bright as the photo: 1 is a white card at 1.

    normals: (H, W, 3) unit vectors in camera space. Where a light does not reach the surface, only grazes it, or its
    channel is saturated, the other channels decide, with the material's mean colour. grey: one value for all channels,
    for a material without colour or lights of unknown strengths.

    One photo has three values per pixel, and the normals were estimated from them: differences in colour between pixels
    depend on how the model separated normal and colour. Equation 2 cannot do so: all is grey to it, except the mean.
    """
    distant = capture if capture.rig.near is None else convert_to_distant_lights(capture)
    usable = usable_channels(capture)
    total, weight = np.zeros(3), np.zeros(3)
    for rows in bands(len(normals)):
        albedo, trust = _single(distant, normals, usable, rows)
        total += (albedo * trust).sum(axis=(0, 1), dtype=np.float64)
        weight += trust.sum(axis=(0, 1), dtype=np.float64)
    # A channel without a usable pixel is assumed black.
    whole = np.maximum(total / np.maximum(weight, 1e-9), 1e-6).astype(np.float32)
    found = np.empty_like(normals)
    for rows in bands(len(normals)):
        albedo, trust = _single(distant, normals, usable, rows)
        known = trust.sum(axis=-1, keepdims=True)
        brightness = (albedo / whole * trust).sum(axis=-1, keepdims=True) / np.maximum(known, 1e-6)
        brightness = np.where(known > 0, brightness, np.float32(1))
        found[rows] = brightness * whole.mean() if grey else trust * albedo + (1 - trust) * brightness * whole
    return found


def _single(distant: Capture, normals: F32, usable: Bools, rows: slice) -> tuple[F32, F32]:
    """The albedo of some rows by each channel alone, and its weight from 0 to 1."""
    light = distant.rig.unmixed(distant.image[rows])
    cosines = normals[rows] @ distant.rig.directions.T.astype(np.float32)
    trust = np.clip((cosines - GRAZING) / (FULL - GRAZING), 0, 1) * usable[rows]
    albedo: F32 = np.divide(np.maximum(light, 0), np.maximum(cosines, np.float32(GRAZING)))
    return albedo, trust.astype(np.float32)


# ----------------------------------------------------------------------------------------------------------------------
# Removal of what does not belong to a material: the photo's tilt, large bends of the cloth, uneven light.


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
