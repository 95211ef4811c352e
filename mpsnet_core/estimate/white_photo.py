"""Normalise a photo by a white photo: it becomes that of the same object painted grey.

Let a be the albedo of a matt surface, s_k the light k that arrives, and M the mixing. The photo is ``c = a M s`` if the
lights' spectra are broad, with one albedo per channel, or ``c = M a s`` if they are narrow, with one albedo per light.
The white photo is ``w_i = g_i a_i Σ_k t_k s_k``, where t_k is how bright light k is in it; i counts channels, or lights
after unmixing. The gains g are unknown: the photos may differ in exposure and white balance.

The albedo cancels in ``g c / w``, if either the photos or their ratio are unmixed. The result is each light's share,
``q = s / Σ_k t_k s_k``. Multiplied by the mean of ``w_i / g_i`` it is ``s`` times one albedo for all three lights: a
photo without colour.

All pixels satisfy ``Σ_k t_k q_k = 1``, in light and in shadow. They lie in a plane, and fitting it determines the
gains. If another lamp lit the white photo, only pixels that all three lights reach lie in the plane. Both orders of
unmixing are tried, and the one with the smaller distances from its plane is used. Highlights on coloured surfaces
lie off the plane and count as outliers; on grey ones they lie in it.
"""

import logging
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.statistics import deviation
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.capture.capture import WHITE_MISFIT, Capture
from mpsnet_core.estimate.distant_lights import lights_in

log = logging.getLogger(__name__)


# Lower limit of the white photo's values, as a share of their channel's mean: below, they are mostly noise.
MIN_WHITE = 0.02
# Weight of the prior that each light's share has the same mean over the object, in squares of the pixels' distances
# from the plane. It decides if a flat surface does not determine the plane, or gloss bends it.
EVEN_SHARES = 1.0
ROUNDS = 10  # of the robust fit
MIN_SPREAD = 0.005  # of the distances from the plane
# Distances of white photos of the same pose are within 0.06, of another pose or under another lamp 0.18 to 0.56.
OTHER_SCENE = 0.12
# In a white photo of the same pose, no more of the object than this is black where the photo shows it lit.
MISPLACED = 0.01
MAX_GAIN_FACTOR = 20.0  # largest factor between the gains and those for which all shares have one mean
MIN_PIXELS = 16
HIGHEST = 95  # percentile; above it are highlights, and pixels that the white lamp hardly reaches
# Below this share of a light's median, the light hardly reaches a pixel. Another lamp's shading is not the sum of the
# lights' there.
REACHED = 0.2
SAMPLED = 20_000  # pixels of a large photo


class WhitePhoto(NamedTuple):
    """Parameters of the division by a white photo."""

    gains: F64
    """(3,). The gains g of the lights."""
    lower_limits: F64
    """(3,). Lower limits of the white photo's channels."""
    unmixing_before: F64
    """(3, 3). Matrix that multiplies both photos: the inverse of the mixing, or the identity."""
    unmixing_after: F64
    """(3, 3). Matrix that multiplies the photos' ratio: the other one of the two."""
    mean_factors: F64
    """(3,). Factors that turn the photo grey on average."""
    spread: float
    """Spread of the pixels about the plane."""

    @classmethod
    def fit(cls, photo: Floats, white: Floats, mixing: F64, strengths: F64) -> "WhitePhoto | None":
        """Fit to pixels (N, 3) of both photos, none of them clipped.

        mixing: of the photo. strengths: t, the lights' strengths in the white photo, (3,) or (N, 3). None if a channel
        of the white photo is black, or too few pixels are bright.
        """
        identity, inverse = np.eye(3), np.linalg.inv(mixing)
        orders = [(identity, inverse), (inverse, identity)][: 1 if np.array_equal(mixing, identity) else 2]
        found: list[tuple[float, WhitePhoto]] = []
        for unmixing_before, unmixing_after in orders:
            photo_values, white_values = photo @ unmixing_before.T, white @ unmixing_before.T
            means = white_values.mean(axis=0) if len(white) else np.zeros(3)
            if (means > 0).all():
                lower_limits = MIN_WHITE * means
                bright = (white_values > lower_limits).all(axis=-1)
                known = strengths if strengths.ndim == 1 else strengths[bright]
                gains, spread = _gains(photo_values[bright], white_values[bright], unmixing_after, known)
                found.append((spread, cls(gains, lower_limits, unmixing_before, unmixing_after, np.ones(3), spread)))
        spread, best = min(found, key=lambda one: one[0], default=(np.inf, None))
        if best is None or not np.isfinite(spread):
            return None
        photo_values = np.maximum(photo @ best.unmixing_before.T, 0)
        grey = (photo_values * best.factors(white)).sum(axis=0)
        total = photo_values.sum(axis=0)
        return best._replace(mean_factors=np.divide(grey, total, out=np.ones(3), where=total > 0))

    def factors(self, white: Floats) -> F32:
        """(..., 3) factors that turn a pixel's channels grey and keep its brightness, from the white photo's pixels."""
        albedo = np.maximum(white @ self.unmixing_before.T.astype(np.float32), self.lower_limits.astype(np.float32))
        albedo /= self.gains.astype(np.float32)
        return np.asarray(albedo.mean(axis=-1, keepdims=True) / albedo, np.float32)

    def separate_lights(self, photo: Floats, factors: Floats) -> F32:
        """(..., 3) each light alone, from pixels (..., 3) of the photo and their factors."""
        photo_values = photo @ self.unmixing_before.T.astype(np.float32)
        return np.asarray(photo_values * factors @ self.unmixing_after.T.astype(np.float32), np.float32)


def normalise_by_white_photo(capture: Capture) -> Capture:
    """The capture as if its surface were grey; each channel is one light alone.

    Where the white photo is clipped, the surface's mean colour is used. Without a white photo the capture is returned
    unchanged; a white photo that is useless is dropped from it.
    """
    if capture.white is None:
        return capture
    fit = fit_white_photo(capture)
    if fit is None:
        return replace(capture, white=None, white_clipped=None)
    if capture.white_light is None and (fit.spread > OTHER_SCENE or _share_in_one_only(capture, fit) > MISPLACED):
        log.warning(WHITE_MISFIT)
    image = np.zeros_like(capture.image)
    for rows in bands(len(image)):
        photo, white = capture.image[rows].astype(np.float32, copy=False), capture.white[rows]
        known = valid_white_pixels(capture, rows)[..., None]
        image[rows] = fit.separate_lights(photo, np.where(known, fit.factors(white), fit.mean_factors))
    rig = replace(capture.rig, mixing=np.eye(3))
    return replace(capture, image=image, rig=rig, clip=np.inf, clipped=capture.saturated_lights)


def fit_white_photo(capture: Capture) -> WhitePhoto | None:
    """Parameters fitted to a sample of the capture's pixels; None if there is no white photo, or it is useless."""
    if capture.white is None:
        return None
    step = grid_step(np.count_nonzero(capture.mask), SAMPLED)
    grid = slice(None, None, step), slice(None, None, step)
    valid = valid_white_pixels(capture, *grid) & ~capture.saturated_in(grid[0])[:, grid[1]].any(axis=-1)
    photo, white = capture.image[grid][valid], capture.white[grid][valid]
    return WhitePhoto.fit(photo, white, capture.rig.mixing, _white_strengths(capture, step, valid))


def _share_in_one_only(capture: Capture, fit: WhitePhoto) -> float:
    """Fraction of the object's pixels that the photo shows lit and the white photo black, which no light can cause."""
    assert capture.white is not None
    step = grid_step(np.count_nonzero(capture.mask), SAMPLED)
    grid = slice(None, None, step), slice(None, None, step)
    inside = valid_white_pixels(capture, *grid)
    brightness = capture.image[grid][inside].astype(np.float32).max(axis=-1)
    black = (capture.white[grid][inside] @ fit.unmixing_before.T < fit.lower_limits).all(axis=-1)
    return float((black & (brightness > REACHED * np.median(brightness))).mean()) if len(black) else 0.0


def _white_strengths(capture: Capture, step: int, valid: Bools) -> F64:
    """How bright each light is in the white photo: (3,), or (N, 3) for the valid pixels on a grid of `step`. If
    another lamp lit it, the combination of lights that equals that lamp."""
    lamp = capture.white_light
    if lamp is None:
        return np.ones(3)
    if capture.rig.near is None:
        return np.asarray(np.linalg.solve(capture.rig.directions.T, lamp))
    rows = range(0, len(capture.mask), step)
    lights = np.concatenate([lights_in(capture, slice(row, row + 1))[:, ::step] for row in rows])[valid]
    return np.asarray(np.linalg.solve(np.swapaxes(lights, -1, -2), lamp[None, :, None])[..., 0])


def valid_white_pixels(capture: Capture, rows: slice, columns: slice = slice(None)) -> Bools:
    """(H, W) where the white photo is valid: inside the mask, and no channel clipped."""
    inside = capture.mask[rows, columns]
    return inside if capture.white_clipped is None else inside & ~capture.white_clipped[rows, columns].any(axis=-1)


def _gains(photo: F64, white: F64, unmixing: F64, strengths: F64) -> tuple[F64, float]:
    """The gains, and the pixels' spread about the plane, infinity if the fit fails. unmixing: applied to the ratio."""
    mixed = np.linalg.inv(unmixing).sum(axis=1)
    if len(photo) < MIN_PIXELS or (mixed <= 0).any():
        return np.ones(3), np.inf
    ratio = photo / white
    share = mixed / max(float(strengths.sum(axis=-1).mean()), 0.1)
    bright, usual_ratio = (np.minimum(values, np.percentile(values, HIGHEST, axis=0)) for values in (white, ratio))
    equal_means = share / np.maximum((usual_ratio * bright).sum(axis=0) / bright.sum(axis=0), 1e-9)
    # Each channel's part of Σ_k t_k q_k; multiplied by the right factors, they add up to 1 in every pixel.
    parts = ratio * equal_means * (strengths @ unmixing)
    light = np.clip((white / np.percentile(white, 99, axis=0)).min(axis=-1), 0, 1)
    weights, spread, factors = light, 4 * MIN_SPREAD, np.ones(3)
    for _ in range(ROUNDS):
        if (strengths != 1).any():  # lit by another lamp than the rig's lights
            shares = (ratio * equal_means * factors) @ unmixing.T
            reached = (shares > REACHED * np.median(shares, axis=0)).all(axis=-1)
            weights = weights * reached if np.count_nonzero(reached) >= MIN_PIXELS else weights
        even = EVEN_SHARES * spread**2
        equations = (weights * parts.T) @ parts / weights.sum() + even * np.eye(3)
        factors = np.linalg.solve(equations, weights @ parts / weights.sum() + even)
        distances = np.abs(parts @ factors - 1)
        spread = deviation(distances, MIN_SPREAD)
        weights = light / (1 + (distances / spread) ** 2)
    gains: F64 = equal_means * np.clip(factors, 1 / MAX_GAIN_FACTOR, MAX_GAIN_FACTOR)
    return gains, spread
