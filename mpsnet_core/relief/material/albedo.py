"""Albedo: how much of each light's colour the surface throws back, once its shape is known."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import under_distant_lights
from mpsnet_core.estimate.estimator import usable_channels

# A light that only grazes the surface (cosine below the first) shows nothing of its colour; above the second, all.
GRAZING, FULL = 0.1, 0.3


def estimated_albedo(capture: Capture, normals: NDArray[np.float32], *, grey: bool = False) -> NDArray[np.float32]:
    """(H, W, 3) the albedo of a matt surface, ``c_i / (n·l_i)``, as bright as the photo: 1 is a white card at 1.

    normals: (H, W, 3) unit vectors in camera space. Where a light does not reach the surface, only grazes it or its
    channel is saturated, the other channels decide, by the colour of the whole. grey: one value for all channels,
    for a material without colour or lights whose strengths are not known.

    One photo has three values a pixel, and the normals were made of them: what differs from pixel to pixel in colour
    rests on the model that separated normal and colour. Equation 2 cannot: to it all is grey but the mean.
    """
    distant = capture if capture.rig.near is None else under_distant_lights(capture)
    usable = usable_channels(capture)
    total, weight = np.zeros(3), np.zeros(3)
    for rows in bands(len(normals)):
        albedo, trust = _single(distant, normals, usable, rows)
        total += (albedo * trust).sum(axis=(0, 1), dtype=np.float64)
        weight += trust.sum(axis=(0, 1), dtype=np.float64)
    # A channel that no pixel has is assumed black.
    whole = np.maximum(total / np.maximum(weight, 1e-9), 1e-6).astype(np.float32)
    found = np.empty_like(normals)
    for rows in bands(len(normals)):
        albedo, trust = _single(distant, normals, usable, rows)
        known = trust.sum(axis=-1, keepdims=True)
        brightness = (albedo / whole * trust).sum(axis=-1, keepdims=True) / np.maximum(known, 1e-6)
        brightness = np.where(known > 0, brightness, np.float32(1))
        found[rows] = brightness * whole.mean() if grey else trust * albedo + (1 - trust) * brightness * whole
    return found


def _single(
    distant: Capture, normals: NDArray[np.float32], usable: NDArray[np.bool_], rows: slice
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Of some rows, the albedo by each channel, and from 0 to 1 how far it is trusted."""
    light = distant.rig.unmixed(distant.image[rows])
    cosines = normals[rows] @ distant.rig.directions.T.astype(np.float32)
    trust = np.clip((cosines - GRAZING) / (FULL - GRAZING), 0, 1) * usable[rows]
    albedo: NDArray[np.float32] = np.divide(np.maximum(light, 0), np.maximum(cosines, np.float32(GRAZING)))
    return albedo, trust.astype(np.float32)
