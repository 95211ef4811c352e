"""Test whether a photo shows a matt surface of one albedo, and find that albedo.

Equation 2 gives a vector for every pixel whose length is the albedo. If a matt surface has one colour and all three
lights reach it, all vectors have the same length once each channel is divided by that colour: the pixels lie on an
ellipsoid (Drew and Kontsevich, "Closed-form attitude determination under spectrally varying illumination", CVPR 1994).
A robust fit finds the colour, and the lengths prove it: pixels with other colours, gloss or shadows lie on the
ellipsoid only by chance.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.estimate.distant_lights import pseudo_normals_by_light

Floats = NDArray[np.floating[Any]]

MIN_PIXELS = 200
# Below this cosine, a light shows little of the colour.
GRAZING = 0.15
# Standard deviations of the lengths in the successive rounds of the robust fit, which starts at the network's normals.
SPREADS = (0.3, 0.15, 0.08, 0.05, 0.03, 0.03)
FURTHER_SPREADS = 3  # additional rounds if the lengths differ by still less
MIN_SPREAD = 0.003
ITERATIONS = 4  # per round
# Conditions of the proof: lengths that differ by at most this,
SHARPEST = 0.02
# a density of pixels at that length so many times the density at others (at least MIN_DENSITY),
PEAK, MIN_DENSITY = 12.0, 0.05
# so many directions (the perplexity of their histogram), because three flat faces fit any colour; a histogram cell
# counts at most this share of the pixels, because one large face must not outweigh all others,
DIRECTIONS, DIRECTION_STEP, LARGEST_FACE = 12.0, 0.2, 0.01
# a colour that they determine (least eigenvalue of the fit's normal equations, per pixel),
DETERMINED = 0.01
# and this share of the object.
MIN_SHARE = 0.1


@dataclass(frozen=True)
class UniformAlbedo:
    """The colour of a uniform surface."""

    gains: NDArray[np.float64]
    """(3,) float64. Gains times unmixed light is each light's cosine on the surface."""
    spread: float
    """Relative standard deviation of the lengths of inliers."""
    determined: float
    """Least eigenvalue of the fit's normal equations, per pixel."""
    density: float
    """Share of all pixels, per unit of length, that are near this length by chance."""
    share: float
    """Share of all pixels that have this length."""

    def sharp(self, peak: float) -> bool:
        """Whether the lengths have one narrow peak, of density `peak`, that determines the gains."""
        narrow = self.spread < SHARPEST and peak > PEAK * self.density
        return narrow and self.share > MIN_SHARE and self.determined > DETERMINED


def find_uniform_albedo(
    light: Floats, lights: NDArray[np.float64], normals: Floats, expected_error: Floats
) -> UniformAlbedo | None:
    """The colour of a matt surface of one albedo, or None if the pixels do not prove that it is one.

    Parameters
    ----------
    light : (N, 3) array
        Unmixed pixels from all over the object, none of them clipped.
    lights : (3, 3) or (N, 3, 3) array
        Directions times brightness, one light per row.
    normals : (N, 3) array
        Unit normals estimated by a network.
    expected_error : (N,) array
        Expected error of `normals` in radians.
    """
    cosines = np.einsum("...ki,...i->...k", lights, normals)
    positive = (light > 0).all(axis=-1)
    bright = positive & (cosines > GRAZING).all(axis=-1)
    if np.count_nonzero(bright) < MIN_PIXELS:
        return None
    parts = pseudo_normals_by_light(light, lights)
    nearby = np.maximum(0.1, 2 * expected_error)
    gains = 1 / np.median(light[bright] / cosines[bright], axis=0)
    spreads = list(SPREADS)
    for number, spread in enumerate(spreads):  # the loop may append to spreads
        for _ in range(ITERATIONS):
            length, vectors, weights = _weighed(parts, gains, normals, nearby, spread)
            weights *= positive
            total = float(weights.sum())
            if total < MIN_PIXELS / 2:
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
                spreads.append(max(2 * found, MIN_SPREAD))
    length, vectors, weights = _weighed(parts, gains, normals, nearby, spread)
    length = np.where(positive, length, 0)
    density_outside = (_density(length, 0.8, 0.9) + _density(length, 1.1, 1.2)) / 2
    close = np.abs(length - 1) < 2 * SPREADS[-1]
    result = UniformAlbedo(
        gains,
        _peak(length, 2 * SPREADS[-1])[1],
        float(np.linalg.eigvalsh(equations)[0]),
        max(density_outside, MIN_DENSITY),
        float(close.mean()),
    )
    proven = result.sharp(_density(length, 0.98, 1.02)) and _directions(vectors, weights * positive) > DIRECTIONS
    return result if proven else None


def _weighed(
    parts: Floats, gains: NDArray[np.float64], normals: Floats, nearby: Floats, spread: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Length (N,) and direction (N, 3) of equation 2's vectors, and the pixels' weights (N,)."""
    vectors = np.einsum("k,nki->ni", gains, parts)
    length = np.linalg.norm(vectors, axis=-1)
    vectors /= np.maximum(length, 1e-9)[:, None]
    off = np.linalg.norm(vectors - normals, axis=-1) / nearby
    return length, vectors, np.exp(-0.5 * (((length - 1) / spread) ** 2 + off**2))


def _peak(length: NDArray[np.float64], within: float) -> tuple[float, float]:
    """Mode of the lengths near one, and their standard deviation if they were normally distributed.

    Uses the shortest interval that holds half of them: interreflections only add to lengths, and would bias a mean.
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
    """Effective number of directions: the perplexity of their histogram over x and y."""
    sure = weights > 0.3
    cells = np.floor(vectors[sure, :2] / DIRECTION_STEP).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    counts = np.bincount(cell.reshape(-1), weights[sure])
    counts = np.minimum(counts, LARGEST_FACE * len(weights))
    shares = counts / max(counts.sum(), 1e-9)
    return float(np.exp(-(shares * np.log(shares)).sum())) if len(shares) else 0.0
