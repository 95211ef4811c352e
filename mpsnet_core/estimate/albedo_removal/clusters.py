"""Find the colours of a painted surface in one photo, as clusters of albedo, and divide them out.

To a network an edge between paints looks much like an edge of the shape, and a photo under three coloured lights does
not show which it is. But estimated normals predict the shading, and the photo divided by it is an estimate of the
albedo. Most objects have few colours, so these albedos cluster: pixels of one paint agree whatever their normals, and
scatter where the normals are wrong. Mean shift on the histogram finds the clusters (Comaniciu and Meer, "Mean shift: a
robust approach toward feature space analysis", PAMI 2002). Divided by its clusters' colours, the object looks as if it
had one paint.

Metals and other surfaces that are not matt have no such clusters and do not change.
"""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.resampling import gaussian, sampled_rows
from mpsnet_core.arrays.types import F32, F64, Floats, Indices
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.albedos import MIN_PIXELS, SAMPLED, divide_out_albedo, pixels_in, valid_in
from mpsnet_core.scene.normal_map import NormalMap

# A pixel's weight is this power of the network's confidence.
POWER_OF_CONFIDENCE = 4
BRIGHT = 95  # percentile
# The histogram of log albedo around the median: half width (darker pixels are in shadow), cell size, standard deviation
# of the smoothing in cells.
HALF_WIDTH, CELL, SMOOTHING = 3.0, 0.1, 1.5
CELLS = round(2 * HALF_WIDTH / CELL)
SHAPE = (CELLS, CELLS, CELLS)
# A cluster with at least this share of the pixels is certain. The colours of smaller ones are divided out in part.
CERTAIN_SHARE = 0.05
# Below this standard deviation of the log colour over all pixels, the surface has one colour.
MIN_DIFFERENCE = 0.2


@dataclass(frozen=True)
class _Clusters:
    """Clusters of colours in a histogram of log albedos."""

    centre: F64
    """(3,). Log albedo at the histogram's centre."""
    offsets: F32
    """(CELLS, CELLS, CELLS, 3). Difference between the log colour of each cell's cluster and the mean."""

    def colours(self, log_albedos: Floats) -> F32:
        """(..., 3) colour of each pixel's cluster divided by the mean colour."""
        return np.exp(self.offsets[tuple(np.moveaxis(_cells(log_albedos, self.centre), -1, 0))])


def divide_out_clustered_albedo(capture: Capture, normals: NormalMap) -> Capture | None:
    """The capture as if its surface had one colour.

    Parameters
    ----------
    capture : Capture
        The photo. Lights may be near.
    normals : NormalMap
        A network's normals in camera space, with its expected error as confidence.

    Returns
    -------
    Capture or None
        Each channel is one light alone. None if the surface has one colour, or too few pixels show its colours.
    """
    clusters = _find_clusters(*_sample(capture, normals))
    if clusters is None:
        return None

    def factors(rows: slice) -> tuple[Floats, Floats]:
        pixels = pixels_in(capture, normals, rows)
        return pixels.light, clusters.colours(pixels.log_albedos)

    return divide_out_albedo(capture, factors)


def _sample(capture: Capture, normals: NormalMap) -> tuple[Floats, Floats]:
    """Log albedo (N, 3) and weight (N,) of pixels from all over the object."""
    albedos, weights = [], []
    for rows, chosen in sampled_rows(capture.mask, SAMPLED):
        pixels = pixels_in(capture, normals, rows)
        chosen &= valid_in(capture, pixels, rows)
        albedos.append(pixels.log_albedos[chosen])
        # A normal error changes the albedo more at small cosines.
        least = np.minimum(pixels.cosines.min(axis=-1), 1)
        weights.append((least * normals.confidence[rows].astype(np.float32) ** POWER_OF_CONFIDENCE)[chosen])
    return np.concatenate(albedos), np.concatenate(weights)


def _find_clusters(log_albedos: Floats, weights: Floats) -> _Clusters | None:
    if len(weights) < MIN_PIXELS:
        return None
    # Centred at the median, unless bright colours would lie outside: with pure paints, each channel is dark in most.
    middle, bright = np.percentile(log_albedos, (50, BRIGHT), axis=0)
    centre = np.maximum(middle, bright - HALF_WIDTH + SMOOTHING * CELL)
    within = (np.abs(log_albedos - centre) < HALF_WIDTH).all(axis=-1)
    place = np.ravel_multi_index(tuple(_cells(log_albedos[within], centre).T), SHAPE)
    weights = weights[within]
    if np.count_nonzero(weights) < MIN_PIXELS:
        return None
    histogram = np.bincount(place, weights / weights.sum(), CELLS**3).astype(np.float64, copy=False).reshape(SHAPE)
    density = gaussian(histogram, SMOOTHING, range(3))
    reached = np.flatnonzero(density > 0)
    peaks = _peaks(density)[reached]
    # A cluster's colour is the mean log albedo around its peak, weighted by the smoothing kernel.
    height = density.ravel()[peaks]
    middles = np.meshgrid(*[(np.arange(CELLS) + 0.5) * CELL - HALF_WIDTH] * 3, indexing="ij", sparse=True)
    moments = (gaussian(histogram * middle, SMOOTHING, range(3)).ravel() for middle in middles)
    colours = np.stack([moment[peaks] for moment in moments], axis=-1) / height[:, None]
    # The mass of a cluster as wide as the smoothing Gaussian, from the height of its peak.
    share = height * (2 * SMOOTHING * np.sqrt(np.pi)) ** 3
    mass = histogram.ravel()[reached]
    offsets = colours - np.average(colours, axis=0, weights=mass * share)
    offsets *= (np.minimum(share / CERTAIN_SHARE, 1) ** 2)[:, None]
    mean = np.average(offsets, axis=0, weights=mass)
    difference = np.sqrt(np.average((offsets - mean) ** 2, axis=0, weights=mass))
    if difference.max() < MIN_DIFFERENCE:
        return None
    table = np.zeros((CELLS**3, 3), np.float32)
    table[reached] = offsets
    return _Clusters(centre, table.reshape(*SHAPE, 3))


def _cells(log_albedos: Floats, centre: F64) -> Indices:
    """(..., 3) cells of the histogram, clamped to its borders."""
    return np.clip((log_albedos - centre + HALF_WIDTH) / CELL, 0, CELLS - 1).astype(np.intp)


def _peaks(density: Floats) -> Indices:
    """(CELLS³,) the peak that steepest ascent reaches from each cell."""
    padded = np.pad(density, 1, constant_values=-1)
    highest, upwards = density.copy(), np.arange(density.size).reshape(SHAPE)
    for steps in np.ndindex(3, 3, 3):
        neighbour = padded[tuple(slice(step, step + CELLS) for step in steps)]
        higher = neighbour > highest
        highest[higher] = neighbour[higher]
        towards = np.ravel_multi_index(steps, SHAPE) - np.ravel_multi_index((1, 1, 1), SHAPE)
        upwards[higher] = np.flatnonzero(higher) + towards
    upwards = upwards.ravel()
    while not np.array_equal(further := upwards[upwards], upwards):
        upwards = further
    return upwards
