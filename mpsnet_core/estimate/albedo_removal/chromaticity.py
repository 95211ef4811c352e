"""Divide out the brightness of a surface's paints, using the chromaticity that a white photo shows.

Normalised by its white photo (:mod:`mpsnet_core.estimate.white_photo`), a surface is still brighter in one paint than
in another, and no photo shows how much of that is shading. But pixels of one chromaticity mostly have one albedo. So
albedos by estimated normals are averaged over pixels of similar chromaticity, and divided out. A surface of one
chromaticity does not change.

Only pixels where the network's normal agrees with equation 2's count: there the surface is matt and fully lit.
"""

import numpy as np

from mpsnet_core.arrays.resampling import gaussian, sampled_rows
from mpsnet_core.arrays.types import Floats, Indices
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.albedos import (
    MIN_PIXELS,
    SAMPLED,
    Pixels,
    divide_out_albedo,
    pixels_in,
    valid_in,
)
from mpsnet_core.estimate.distant_lights import pseudo_normals
from mpsnet_core.estimate.white_photo import WhitePhoto, fit_white_photo, valid_white_pixels
from mpsnet_core.scene.normal_map import NormalMap

# The histogram over log(red / green) and log(blue / green): half width, cell size, standard deviation of the smoothing
# in cells.
HALF_WIDTH, CELL, SMOOTHING = 3.0, 0.1, 1.0
CELLS = round(2 * HALF_WIDTH / CELL)
# Standard deviation of the network's normals from equation 2's, as chord length.
AGREEMENT = np.radians(5.0)
# Weight of the mean albedo in each cell, as a share of the object's pixels.
PRIOR = 0.001
MIN_SQUARES = 0.05  # sum of the three squared cosines; below, the albedo would be mostly noise
MIN_ALBEDO = 0.02  # as a share of the median


def divide_out_chromaticity_albedo(photo: Capture, grey: Capture, normals: NormalMap) -> Capture:
    """`grey` with the brightness of its paints divided out.

    Parameters
    ----------
    photo : Capture
        The capture with its white photo.
    grey : Capture
        The same, normalised by the white photo.
    normals : NormalMap
        A network's normals of `grey`, in camera space.
    """
    fit, white = fit_white_photo(photo), photo.white
    if fit is None or white is None:
        return grey
    chromaticities, albedos, weights = _sample(photo, grey, normals, fit, white)
    if len(albedos) < MIN_PIXELS or weights.sum() <= 0:
        return grey
    cells, shares = _corners(chromaticities)
    offset = np.log(np.maximum(albedos / np.median(albedos), MIN_ALBEDO))
    offset -= np.average(offset, weights=weights)
    total, count = (_smoothed_sums(cells, shares * values[:, None]) for values in (weights * offset, weights))
    brightness = (total / (count + PRIOR * len(weights))).astype(np.float32)

    def factors(rows: slice) -> tuple[Floats, Floats]:
        cells, shares = _corners(_chromaticities(fit, white[rows]))
        shares *= valid_white_pixels(grey, rows)[..., None]
        return grey.image[rows], np.exp((brightness[cells] * shares).sum(axis=-1))[..., None]

    return divide_out_albedo(grey, factors)


def _sample(
    photo: Capture, grey: Capture, normals: NormalMap, fit: WhitePhoto, white: Floats
) -> tuple[Floats, Floats, Floats]:
    """Chromaticity (N, 2), albedo (N,) and weight (N,) of pixels from all over the object."""
    chromaticities, albedos, weights = [], [], []
    for rows, chosen in sampled_rows(grey.mask, SAMPLED):
        pixels = pixels_in(grey, normals, rows)
        chosen &= valid_in(grey, pixels, rows) & valid_white_pixels(grey, rows)
        chromaticities.append(_chromaticities(fit, white[rows])[chosen])
        albedos.append(_albedos(pixels)[chosen])
        solved = normalised(pseudo_normals(np.maximum(pixels.light, 0), pixels.lights))
        off = np.linalg.norm(solved - normals.vectors[rows], axis=-1)
        weights.append(np.exp(-0.5 * (off / AGREEMENT) ** 2)[chosen])
    return np.concatenate(chromaticities), np.concatenate(albedos), np.concatenate(weights)


def _albedos(pixels: Pixels) -> Floats:
    """(...) least-squares albedo over the three lights."""
    cosines = np.maximum(pixels.cosines, 0)
    brightness = (np.maximum(pixels.light, 0) * cosines).sum(axis=-1)
    return brightness / np.maximum((cosines**2).sum(axis=-1), MIN_SQUARES)


def _chromaticities(fit: WhitePhoto, pixels: Floats) -> Floats:
    """(..., 2) log(red / green) and log(blue / green)."""
    red, green, blue = np.moveaxis(np.log(fit.factors(pixels)), -1, 0)
    return np.stack([green - red, green - blue], axis=-1)


def _corners(chromaticities: Floats) -> tuple[Indices, Floats]:
    """Indices (..., 4) of the four cells around each chromaticity in the flat histogram, and bilinear weights."""
    place = np.clip((chromaticities + HALF_WIDTH) / CELL - 0.5, 0, CELLS - 1.001)
    first = place.astype(np.intp)
    (x, y), (u, v) = np.moveaxis(first, -1, 0), np.moveaxis(place - first, -1, 0)
    corner = x * CELLS + y
    cells = np.stack([corner, corner + 1, corner + CELLS, corner + CELLS + 1], axis=-1)
    return cells, np.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], axis=-1)


def _smoothed_sums(cells: Indices, values: Floats) -> Floats:
    """(CELLS²,) sums of the values in each cell, smoothed."""
    sums: Floats = np.bincount(cells.ravel(), values.ravel(), CELLS**2).astype(np.float64, copy=False)
    return gaussian(sums.reshape(CELLS, CELLS), SMOOTHING, range(2)).ravel()
