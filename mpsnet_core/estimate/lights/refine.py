"""Lights refined by the object itself: they are right if the normals that follow from them belong to one surface.

Equation 2 makes three normals' components of three channels. Under the right lights

- their gradients have no curl (Yuille and Snow, "Shape and albedo from multiple images using integrability", CVPR
  1997); paint of one hue cancels in that,
- most of the object has one albedo (Alldrin, Mallick and Kriegman, "Resolving the generalized bas-relief ambiguity by
  entropy minimization", CVPR 2007),
- normals at the outline point outwards.

Each of them fails somewhere: at shadows, highlights, and edges of paint. So residuals have Cauchy's distribution, whose
width follows them, and the network's guess is the prior.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.orientation import WHOLE, outline_of
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.estimate.lights.network import LightsGuess

BLOCKS = 90  # The object's longer side is reduced to about this many.
SHADOW = 0.08  # Lights up to this share of their channel's 95th percentile do not reach a block.
MIN_BLOCKS = 300  # with a curl
# How many independent observations the blocks' curl, albedo and outline count as, and the least widths of their
# distributions.
CURL, ALBEDO, OUTLINE = 60.0, 30.0, 20.0
LEAST_CURL, LEAST_ALBEDO, LEAST_OUTLINE, LEAST_FACING = 0.05, 0.05, 0.15, 0.1
STEEP = 0.6  # z that normals at the outline do not exceed
STRENGTHS = 0.5  # standard deviation of the logarithms of the channels' strengths
WIDTHS, STEPS, SETTLED = 3, 20, 1e-3  # rounds of new widths, steps in each, and radians
UNDAMPED = 1e-2


def refine(photos: Sequence[tuple[NDArray[np.floating[Any]], NDArray[np.bool_]]], guess: LightsGuess) -> LightsGuess:
    """The lights of photos (H, W, 3) under the same three lights, of objects with masks (H, W), near a guess.

    Photos of which too little is lit by all lights are left out.
    """
    seen = [one for one in (_observed(*photo) for photo in photos) if len(one.across) >= MIN_BLOCKS]
    if not seen:
        return guess
    fit = _Fit(seen, guess)
    for _ in range(WIDTHS):
        fit.new_widths()
        for _ in range(STEPS):
            if not fit.step():
                break
    return fit.result()


class _Observed(NamedTuple):
    """What a photo shows, in blocks that all lights reach."""

    lit: NDArray[np.float64]
    """(P, 3) colours."""
    across: NDArray[np.float64]
    """(Q, 3) cross products of colours, where the neighbours are lit, too, with their derivatives to the right."""
    up: NDArray[np.float64]
    """(Q, 3) those with their derivatives upwards."""
    rim: NDArray[np.float64]
    """(R, 3) colours at the outline."""
    outwards: NDArray[np.float64]
    """(R, 2) unit vectors across the outline."""


def _observed(pixels: NDArray[np.floating[Any]], mask: NDArray[np.bool_]) -> _Observed:
    box = bounding_box(mask)
    border = [(part.start == 0, part.stop >= size) for part, size in zip(box, mask.shape, strict=True)]
    inside = mask[box][..., None]
    factor = max(1, round(max(inside.shape) / BLOCKS))
    planes = np.concatenate([np.where(inside, pixels[box], 0), inside], axis=-1, dtype=np.float32)
    means = np.pad(block_means(planes, factor).astype(np.float64), [(1, 1), (1, 1), (0, 0)])
    colours, covered = means[..., :3], means[..., 3]
    whole = covered > WHOLE
    bright = np.percentile(colours[whole], 95, axis=0) if whole.any() else np.ones(3)
    colours = colours / np.maximum(bright, 1e-12)
    lit = whole & (colours > SHADOW).all(axis=-1)
    inner = lit.copy()
    for axis in (0, 1):
        inner &= np.roll(lit, 1, axis) & np.roll(lit, -1, axis)
    down, right = np.gradient(colours, axis=(0, 1)) if inner.any() else (colours, colours)
    outline = outline_of(covered[1:-1, 1:-1], border)
    rim = np.pad(outline.rim, 1) & lit
    own = colours[inner]
    outwards = outline.outwards[rim[1:-1, 1:-1]]
    return _Observed(colours[lit], np.cross(own, right[inner]), np.cross(own, -down[inner]), colours[rim], outwards)


class _Fit:
    """Unknowns: two angles of each light, and for each photo the logarithms of two channels' strengths."""

    def __init__(self, seen: Sequence[_Observed], guess: LightsGuess) -> None:
        self.seen, self.guess = seen, guess
        self.tangents = np.array([np.linalg.svd(light[None])[2][1:] for light in guess.directions])
        self.values = np.zeros(6 + 2 * len(seen))
        self.widths = [np.ones(4)] * len(seen)
        self.damping = 1e-3
        self.matrix = np.eye(len(self.values))

    def directions(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, 3) unit vectors by six angles."""
        return normalised(self.guess.directions + np.einsum("ka,kai->ki", angles.reshape(3, 2), self.tangents))

    def measures(self, number: int, values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Curl, deviation of the albedo, of the outline and of facing the camera, of a photo by its own (8,) values."""
        seen, strengths = self.seen[number], np.exp([values[6], values[7], -values[6] - values[7]])
        inverse = np.linalg.inv(self.directions(values[:6]) * strengths[:, None])
        along = np.cross(inverse[2], inverse[:2]).T
        x, y = seen.across @ along, seen.up @ along
        size = np.sqrt(dot(x, x) + dot(y, y))
        curl = (y[:, 0] - x[:, 1]) / (size + 0.1 * np.median(size) + 1e-12)
        scaled = seen.lit @ inverse.T
        length = np.maximum(np.linalg.norm(scaled, axis=1), 1e-12)
        albedo = np.log(length)
        rim = normalised(seen.rim @ inverse.T)
        turned = rim[:, 0] * seen.outwards[:, 1] - rim[:, 1] * seen.outwards[:, 0]
        inwards = np.minimum(dot(rim[:, :2], seen.outwards), 0)
        outline = np.concatenate([turned, inwards, np.minimum(rim[:, 2], 0), np.maximum(rim[:, 2] - STEEP, 0)])
        return [curl, albedo - np.median(albedo), outline, np.minimum(scaled[:, 2] / length, 0)]

    def new_widths(self) -> None:
        """Set each distribution's width to what its residuals have now."""
        least = np.array([LEAST_CURL, LEAST_ALBEDO, LEAST_OUTLINE])
        for number in range(len(self.seen)):
            measures = self.measures(number, self.own(number))[:3]
            spread = [1.4826 * np.median(np.abs(one)) if len(one) else 0 for one in measures]
            self.widths[number] = np.append(np.maximum(spread, least), LEAST_FACING)

    def own(self, number: int, values: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """(8,) the values of one photo."""
        values = self.values if values is None else values
        return np.concatenate([values[:6], values[6 + 2 * number : 8 + 2 * number]])

    def residuals(self, number: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of a photo: the sum of their squares is the negative logarithm of the probability, doubled."""
        found = []
        for one, width, count in zip(
            self.measures(number, values), self.widths[number], (CURL, ALBEDO, OUTLINE, OUTLINE), strict=True
        ):
            weight = count / max(len(one), 1)
            found.append(np.sign(one) * np.sqrt(weight * np.log1p((one / width) ** 2)))
        return np.concatenate([*found, np.array([*values[6:], values[6:].sum()]) / STRENGTHS])

    def prior(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """(6,) deviations of the angles from the guess."""
        return (values[:6].reshape(3, 2) / self.guess.errors[:, None]).ravel()

    def cost(self, values: NDArray[np.float64]) -> float:
        photos = sum(float(np.sum(self.residuals(k, self.own(k, values)) ** 2)) for k in range(len(self.seen)))
        return float(np.sum(self.prior(values) ** 2)) + photos

    def step(self) -> bool:
        """A step of Levenberg and Marquardt. Returns whether another may help."""
        count, small = len(self.values), 1e-5
        matrix, right = np.zeros((count, count)), np.zeros(count)
        precision = np.repeat(1 / self.guess.errors**2, 2)
        matrix[range(6), range(6)] = precision
        right[:6] = precision * self.values[:6]
        for number in range(len(self.seen)):
            own = self.own(number)
            residuals = self.residuals(number, own)
            moved = [self.residuals(number, own + small * one) for one in np.eye(8)]
            jacobian = (np.array(moved).T - residuals[:, None]) / small
            places = [*range(6), 6 + 2 * number, 7 + 2 * number]
            matrix[np.ix_(places, places)] += jacobian.T @ jacobian
            right[places] += jacobian.T @ residuals
        self.matrix, before = matrix, self.cost(self.values)
        while self.damping < 1e3:
            change = np.linalg.solve(matrix + self.damping * np.diag(np.diag(matrix)), right)
            if self.cost(self.values - change) < before:
                self.values = self.values - change
                damped, self.damping = self.damping > UNDAMPED, max(self.damping / 5, 1e-4)
                return damped or bool(np.abs(change).max() > SETTLED)  # a damped step is small anywhere
            self.damping *= 5
        self.damping = 1e-3
        return False

    def result(self) -> LightsGuess:
        spread = np.diag(np.linalg.inv(self.matrix))[:6].reshape(3, 2).sum(axis=1)
        return LightsGuess(self.directions(self.values[:6]), np.sqrt(spread))
