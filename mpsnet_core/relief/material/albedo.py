"""Albedo: the fraction of each light's colour that the surface reflects, once its shape is known."""

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import convert_to_distant_lights
from mpsnet_core.estimate.estimator import usable_channels

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
