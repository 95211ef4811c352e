"""Whether a photo shows a matt surface of one albedo, and which.

Equation 2 gives a vector for every pixel, as long as the surface's albedo there. Where a matt surface has one colour
and all three lights reach, the vectors of all pixels have one length once each channel is divided by that colour: the
pixels lie on an ellipsoid (Drew and Kontsevich, "Closed-form attitude determination under spectrally varying
illumination", CVPR 1994). So a robust fit finds the colour, and the lengths prove it: where the surface has other
colours, gloss or shadows, its pixels lie on that ellipsoid by chance alone.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.estimate.distant_lights import pseudo_normals_by_light

Floats = NDArray[np.floating[Any]]

LEAST_PIXELS = 200
# Cosines: below, a light says little of the colour.
GRAZING = 0.15
# Standard deviations of the lengths in the robust fit, one after the other, from where the network's normals lead to.
SPREADS = (0.3, 0.15, 0.08, 0.05, 0.03, 0.03)
FURTHER_SPREADS = 3  # where the lengths differ by still less
LEAST_SPREAD = 0.003
ITERATIONS = 4  # with each of them
# What must hold for a proof: lengths that differ by at most this,
SHARPEST = 0.02
# this many times as many pixels of that length as of others (per unit of length, and at least LEAST_DENSITY of those),
PEAK, LEAST_DENSITY = 12.0, 0.05
# on a surface of so many directions (the perplexity of their histogram), as three flat faces fit any colour,
# each with this share of the pixels at most, so that one large face hides no others,
DIRECTIONS, DIRECTION_STEP, LARGEST_FACE = 12.0, 0.2, 0.01
# that determine the colour (least eigenvalue of the fit's normal equations, for one pixel),
DETERMINED = 0.01
# and on this share of the object.
LEAST_SHARE = 0.1


@dataclass(frozen=True)
class UniformAlbedo:
    """A surface's one colour.

    Attributes
    ----------
    gains : (3,) float64 array
        Unmixed light times these is each light's cosine on the surface.
    spread : float
        Relative standard deviation of the lengths where it holds.
    determined : float
        Least eigenvalue of the fit's normal equations, for one pixel.
    density : float
        Pixels per unit of length that have a length nearby by chance, as a share of all.
    share : float
        Of all pixels that have that length.
    """

    gains: NDArray[np.float64]
    spread: float
    determined: float
    density: float
    share: float


def find_uniform_albedo(
    light: Floats, lights: NDArray[np.float64], normals: Floats, expected_error: Floats
) -> UniformAlbedo | None:
    """The one colour of a matt surface, or None where the pixels do not prove it.

    Parameters
    ----------
    light : (N, 3) array
        Each light alone (unmixed), of pixels from all over the object; not clipped.
    lights : (3, 3) or (N, 3, 3) array
        A light a row: its direction times its brightness.
    normals : (N, 3) array
        Unit vectors, as a network estimates them.
    expected_error : (N,) array
        Of those, in radians.
    """
    cosines = np.einsum("...ki,...i->...k", lights, normals)
    positive = (light > 0).all(axis=-1)
    bright = positive & (cosines > GRAZING).all(axis=-1)
    if np.count_nonzero(bright) < LEAST_PIXELS:
        return None
    parts = pseudo_normals_by_light(light, lights)
    nearby = np.maximum(0.1, 2 * expected_error)
    gains = 1 / np.median(light[bright] / cosines[bright], axis=0)
    spreads = list(SPREADS)
    for number, spread in enumerate(spreads):  # which may become longer meanwhile
        for _ in range(ITERATIONS):
            length, vectors, weights = _weighed(parts, gains, normals, nearby, spread)
            weights *= positive
            total = float(weights.sum())
            if total < LEAST_PIXELS / 2:
                return None
            gradient = np.einsum("ni,nki->nk", vectors, parts) * gains
            equations = np.einsum("nj,nk,n->jk", gradient, gradient, weights) / total
            change = np.linalg.solve(
                equations + 1e-4 * np.eye(3), np.einsum("nk,n->k", gradient, weights * (1 - length)) / total
            )
            gains = gains * np.exp(np.clip(change, -0.3, 0.3))
        if number == len(spreads) - 1 and len(spreads) < len(SPREADS) + FURTHER_SPREADS:
            length = _weighed(parts, gains, normals, nearby, spread)[0]
            centre, found = _peak(length[positive], 2 * spread)
            if found < 0.6 * spread:
                gains /= centre
                spreads.append(max(2 * found, LEAST_SPREAD))
    length, vectors, weights = _weighed(parts, gains, normals, nearby, spread)
    length = np.where(positive, length, 0)
    beside = (_density(length, 0.8, 0.9) + _density(length, 1.1, 1.2)) / 2
    close = np.abs(length - 1) < 2 * SPREADS[-1]
    result = UniformAlbedo(
        gains,
        _peak(length, 2 * SPREADS[-1])[1],
        float(np.linalg.eigvalsh(equations)[0]),
        max(beside, LEAST_DENSITY),
        float(close.mean()),
    )
    proven = (
        result.share > LEAST_SHARE
        and result.spread < SHARPEST
        and _density(length, 0.98, 1.02) > PEAK * result.density
        and result.determined > DETERMINED
        and _directions(vectors, weights * positive) > DIRECTIONS
    )
    return result if proven else None


def _weighed(
    parts: Floats, gains: NDArray[np.float64], normals: Floats, nearby: Floats, spread: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Length (N,) and direction (N, 3) of equation 2's vectors, and how much a pixel counts (N,)."""
    vectors = np.einsum("k,nki->ni", gains, parts)
    length = np.linalg.norm(vectors, axis=-1)
    vectors /= np.maximum(length, 1e-9)[:, None]
    off = np.linalg.norm(vectors - normals, axis=-1) / nearby
    return length, vectors, np.exp(-0.5 * (((length - 1) / spread) ** 2 + off**2))


def _peak(length: NDArray[np.float64], within: float) -> tuple[float, float]:
    """Where lengths near one are densest, and their standard deviation there, as if they were normal.

    By the shortest interval that holds half of them: light that bounces between surfaces only adds to lengths.
    """
    close = np.sort(length[np.abs(length - 1) < within])
    half = len(close) // 2
    if half < 2:
        return 1.0, np.inf
    widths = close[half:] - close[: len(close) - half]
    first = int(np.argmin(widths))
    return float(close[first] + close[first + half]) / 2, float(widths[first]) / (2 * 0.6745)


def _density(length: NDArray[np.float64], low: float, high: float) -> float:
    return float(((length > low) & (length < high)).mean() / (high - low))


def _directions(vectors: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """How many directions there are: the perplexity of their histogram over x and y."""
    sure = weights > 0.3
    cells = np.floor(vectors[sure, :2] / DIRECTION_STEP).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    counts = np.bincount(cell.reshape(-1), weights[sure])
    counts = np.minimum(counts, LARGEST_FACE * len(weights))
    shares = counts / max(counts.sum(), 1e-9)
    return float(np.exp(-(shares * np.log(shares)).sum())) if len(shares) else 0.0
