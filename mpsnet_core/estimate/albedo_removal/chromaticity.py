"""How bright a painted surface's colours are, with a white photo that shows their chromaticity.

Painted grey by its white photo (:mod:`mpsnet_core.estimate.white_photo`), a surface still is brighter in one paint than
in another, and no photo shows how much of that is shading. But what has one chromaticity mostly has one albedo. So
albedos by estimated normals are averaged over all pixels of like chromaticity, and divided out. A surface of one
chromaticity stays as it is.

Only pixels count where the network's normal and equation 2's agree: there the surface is matt, and all lights reach.
"""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.gaussian import gaussian
from mpsnet_core.arrays.sampling import sampled_rows
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.albedos import (
    LEAST_PIXELS,
    SAMPLED,
    Floats,
    Pixels,
    divided_by,
    pixels_in,
    valid_in,
)
from mpsnet_core.estimate.distant_lights import pseudo_normals
from mpsnet_core.estimate.white_photo import WhitePhoto, measured_white, white_valid
from mpsnet_core.scene.normal_map import NormalMap

# Over the logarithms of red and blue against green: half of its width, the side of a cell, and the standard deviation
# in cells by which it is smoothed.
HALF_WIDTH, CELL, SMOOTHING = 3.0, 0.1, 1.0
CELLS = round(2 * HALF_WIDTH / CELL)
# The standard deviation, as a chord, of the network's normals from equation 2's.
AGREEMENT = np.radians(5.0)
# Shares of the object: so many pixels of the mean albedo count beside those of a cell.
PRIOR = 0.001
LEAST_SQUARES = 0.05  # sum of the three squared cosines; below, the albedo would be mostly noise
LEAST_ALBEDO = 0.02  # as a share of the median


def without_chromaticity_albedo(photo: Capture, painted: Capture, normals: NormalMap) -> Capture:
    """`painted` with the brightness of its colours divided out.

    Parameters
    ----------
    photo : Capture
        With its white photo.
    painted : Capture
        The same, painted grey.
    normals : NormalMap
        A network's of `painted`, in camera space.
    """
    measured, white = measured_white(photo), photo.white
    if measured is None or white is None:
        return painted
    chromaticities, albedos, weights = _sample(photo, painted, normals, measured, white)
    if len(albedos) < LEAST_PIXELS or weights.sum() <= 0:
        return painted
    cells, shares = _corners(chromaticities)
    offset = np.log(np.maximum(albedos / np.median(albedos), LEAST_ALBEDO))
    offset -= np.average(offset, weights=weights)
    total, count = (_smoothed_sums(cells, shares * values[:, None]) for values in (weights * offset, weights))
    brightness = (total / (count + PRIOR * len(weights))).astype(np.float32)

    def factors(rows: slice) -> tuple[Floats, Floats]:
        cells, shares = _corners(_chromaticities(measured, white[rows]))
        shares *= white_valid(painted, rows)[..., None]
        return painted.image[rows], np.exp((brightness[cells] * shares).sum(axis=-1))[..., None]

    return divided_by(painted, factors)


def _sample(
    photo: Capture, painted: Capture, normals: NormalMap, measured: WhitePhoto, white: Floats
) -> tuple[Floats, Floats, Floats]:
    """Of pixels from all over the object: chromaticity (N, 2), albedo (N,), and how much each counts (N,)."""
    chromaticities, albedos, weights = [], [], []
    for rows, chosen in sampled_rows(painted.mask, SAMPLED):
        pixels = pixels_in(painted, normals, rows)
        chosen &= valid_in(painted, pixels, rows) & white_valid(painted, rows)
        chromaticities.append(_chromaticities(measured, white[rows])[chosen])
        albedos.append(_albedos(pixels)[chosen])
        solved = normalised(pseudo_normals(np.maximum(pixels.light, 0), pixels.lights))
        off = np.linalg.norm(solved - normals.vectors[rows], axis=-1)
        weights.append(np.exp(-0.5 * (off / AGREEMENT) ** 2)[chosen])
    return np.concatenate(chromaticities), np.concatenate(albedos), np.concatenate(weights)


def _albedos(pixels: Pixels) -> Floats:
    """(...) the albedo that explains all three lights best, in the sense of least squares."""
    cosines = np.maximum(pixels.cosines, 0)
    brightness = (np.maximum(pixels.light, 0) * cosines).sum(axis=-1)
    albedos: Floats = brightness / np.maximum((cosines**2).sum(axis=-1), LEAST_SQUARES)
    return albedos


def _chromaticities(measured: WhitePhoto, pixels: Floats) -> Floats:
    """(..., 2) logarithms of red against green and of blue against green."""
    red, green, blue = np.moveaxis(np.log(measured.factors(pixels)), -1, 0)
    return np.stack([green - red, green - blue], axis=-1)


def _corners(chromaticities: Floats) -> tuple[NDArray[np.intp], Floats]:
    """The four cells around each chromaticity (..., 4), as indices into the flat table, and their bilinear shares."""
    place = np.clip((chromaticities + HALF_WIDTH) / CELL - 0.5, 0, CELLS - 1.001)
    first = place.astype(np.intp)
    (x, y), (u, v) = np.moveaxis(first, -1, 0), np.moveaxis(place - first, -1, 0)
    corner = x * CELLS + y
    cells = np.stack([corner, corner + 1, corner + CELLS, corner + CELLS + 1], axis=-1)
    return cells, np.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], axis=-1)


def _smoothed_sums(cells: NDArray[np.intp], values: Floats) -> Floats:
    """(CELLS²,) the values that fall into each cell, smoothed."""
    sums: Floats = np.bincount(cells.ravel(), values.ravel(), CELLS**2).astype(np.float64, copy=False)
    return gaussian(sums.reshape(CELLS, CELLS), SMOOTHING, range(2)).ravel()
