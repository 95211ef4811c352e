"""The colours of a painted surface from one photo, as clusters of albedo.

To a network an edge of two paints looks much like an edge of the shape, and a photo under three coloured lights does
not show which one it is. But estimated normals predict how bright each light is on the surface, and the photo divided
by that is an estimate of the albedo. Most things have few colours, so these albedos cluster: pixels of one paint agree
wherever they face, and where the normals are wrong they scatter. Mean shift on their histogram finds the clusters
(Comaniciu and Meer, "Mean shift: a robust approach toward feature space analysis", PAMI 2002). Divided by its
cluster's colour, each pixel looks as if all of the object had one paint.

Metals, and whatever else is not matt, have no such clusters and stay as they are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.gaussian import gaussian
from mpsnet_core.arrays.sampling import sampled_rows
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.albedos import LEAST_PIXELS, SAMPLED, Floats, divided_by, pixels_in, valid_in
from mpsnet_core.scene.normal_map import NormalMap

# A pixel counts by this power of how sure the network is of its normal.
POWER_OF_CONFIDENCE = 4
BRIGHT = 95  # percentile
# The histogram of logarithms of albedo, around their median: its half width (what is darker lies in shadow), the side
# of a cell, and the standard deviation in cells by which it is smoothed.
HALF_WIDTH, CELL, SMOOTHING = 3.0, 0.1, 1.5
CELLS = round(2 * HALF_WIDTH / CELL)
SHAPE = (CELLS, CELLS, CELLS)
# The share of the pixels that makes a cluster certain. Smaller ones' colours are divided out in part.
CERTAIN_SHARE = 0.05
# Colours that differ by less (standard deviation of the logarithm, over pixels) are one.
LEAST_DIFFERENCE = 0.2


@dataclass(frozen=True)
class _Clusters:
    """centre: (3,) logarithms in the histogram's middle. offsets: (CELLS, CELLS, CELLS, 3) how far the colour of each
    cell's cluster is from the mean colour, in logarithms."""

    centre: NDArray[np.float64]
    offsets: NDArray[np.float32]

    def colours(self, log_albedos: Floats) -> NDArray[np.float32]:
        """(..., 3) the colour of each pixel's cluster, as a multiple of the mean colour."""
        colours: NDArray[np.float32] = np.exp(self.offsets[tuple(np.moveaxis(_cells(log_albedos, self.centre), -1, 0))])
        return colours


def without_clustered_albedo(capture: Capture, normals: NormalMap) -> Capture | None:
    """The capture as if all of its surface had one colour.

    Parameters
    ----------
    capture : Capture
        The photo. Lights may be near.
    normals : NormalMap
        A network's, in camera space, with its expected error as confidence.

    Returns
    -------
    Capture or None
        Each channel is one light alone. None where the surface has one colour, or too few pixels show its colours.
    """
    clusters = _find_clusters(*_sample(capture, normals))
    if clusters is None:
        return None

    def factors(rows: slice) -> tuple[Floats, Floats]:
        pixels = pixels_in(capture, normals, rows)
        return pixels.light, clusters.colours(pixels.log_albedos)

    return divided_by(capture, factors)


def _sample(capture: Capture, normals: NormalMap) -> tuple[Floats, Floats]:
    """Logarithms of albedo (N, 3) from all over the object, and how much each counts (N,)."""
    albedos, weights = [], []
    for rows, chosen in sampled_rows(capture.mask, SAMPLED):
        pixels = pixels_in(capture, normals, rows)
        chosen &= valid_in(capture, pixels, rows)
        albedos.append(pixels.log_albedos[chosen])
        # An error of the normal changes the albedo the more, the smaller the cosine is.
        least = np.minimum(pixels.cosines.min(axis=-1), 1)
        weights.append((least * normals.confidence[rows].astype(np.float32) ** POWER_OF_CONFIDENCE)[chosen])
    return np.concatenate(albedos), np.concatenate(weights)


def _find_clusters(log_albedos: Floats, weights: Floats) -> _Clusters | None:
    if len(weights) < LEAST_PIXELS:
        return None
    # The median, unless bright colours would lie outside: of pure paints each channel's median is of the others.
    middle, bright = np.percentile(log_albedos, (50, BRIGHT), axis=0)
    centre = np.maximum(middle, bright - HALF_WIDTH + SMOOTHING * CELL)
    within = (np.abs(log_albedos - centre) < HALF_WIDTH).all(axis=-1)
    place = np.ravel_multi_index(tuple(_cells(log_albedos[within], centre).T), SHAPE)
    weights = weights[within]
    if np.count_nonzero(weights) < LEAST_PIXELS:
        return None
    histogram = np.bincount(place, weights / weights.sum(), CELLS**3).astype(np.float64, copy=False).reshape(SHAPE)
    density = gaussian(histogram, SMOOTHING, range(3))
    reached = np.flatnonzero(density > 0)
    peaks = _peaks(density)[reached]
    # A cluster's colour: the mean of the albedos around its peak, as the smoothed histogram weighs them.
    height = density.ravel()[peaks]
    middles = np.meshgrid(*[(np.arange(CELLS) + 0.5) * CELL - HALF_WIDTH] * 3, indexing="ij", sparse=True)
    moments = (gaussian(histogram * middle, SMOOTHING, range(3)).ravel() for middle in middles)
    colours = np.stack([moment[peaks] for moment in moments], axis=-1) / height[:, None]
    # What a cluster as wide as the Gaussian holds if its peak is so high.
    share = height * (2 * SMOOTHING * np.sqrt(np.pi)) ** 3
    mass = histogram.ravel()[reached]
    offsets = colours - np.average(colours, axis=0, weights=mass * share)
    offsets *= (np.minimum(share / CERTAIN_SHARE, 1) ** 2)[:, None]
    mean = np.average(offsets, axis=0, weights=mass)
    difference = np.sqrt(np.average((offsets - mean) ** 2, axis=0, weights=mass))
    if difference.max() < LEAST_DIFFERENCE:
        return None
    table = np.zeros((CELLS**3, 3), np.float32)
    table[reached] = offsets
    return _Clusters(centre, table.reshape(*SHAPE, 3))


def _cells(log_albedos: Floats, centre: NDArray[np.float64]) -> NDArray[np.intp]:
    """(..., 3) the cells of the histogram; the nearest for what lies beyond."""
    return np.clip((log_albedos - centre + HALF_WIDTH) / CELL, 0, CELLS - 1).astype(np.intp)


def _peaks(density: Floats) -> NDArray[np.intp]:
    """(CELLS³,) the peak that the steepest way up from each cell leads to."""
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
