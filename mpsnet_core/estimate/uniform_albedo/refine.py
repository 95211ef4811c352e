"""Normals of a matt surface of one colour, from which lights reach each pixel.

Once the colour is known, every light that reaches a pixel says what angle it makes with the normal. What is not known
is which lights reach it; that is one of seven hypotheses:

* all three: equation 2, and the length of its vector must be the albedo;
* two of them, the third blocked: two normals fit (Hernández et al., "Shadows in three-source photometric stereo", ECCV
  2008), and the network's own says which;
* one: the normal lies on a cone, and the nearest to the network's own is taken.

Or, last, none of them: another material, gloss, bounced light. Each hypothesis has a probability by what the pixel
shows, how far its normal is from the network's own, as against the error that the network expects, and what is so
around it. The result is the mean over all, each of them a mean with the network's own normal by both errors.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box, box_sums
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.sampling import sampled_rows
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in, pseudo_normals
from mpsnet_core.estimate.uniform_albedo.fit import LEAST_SPREAD, Floats, UniformAlbedo, find_uniform_albedo
from mpsnet_core.estimate.uniform_albedo.halving import halved, mend
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

RIGHT_ANGLE = np.pi / 2
# Pixels that the colour is found by, at full resolution and at less, and the side of the tiles that the cores work on.
SAMPLED, SAMPLED_HALVED = 10_000, 2_500
TILE = 256
# The error of equation 2 in radians for each relative error of the albedo, where the fit determines the colour so well.
ERROR_OF_SPREAD, WELL_DETERMINED = 3.5, 0.05
# Where equation 2 holds, networks err less than they expect.
ERROR_WHERE_LIT = 0.65
# The spread of a direction whose mean error is one.
SPREAD_OF_ERROR = 0.8
# Of the network's expected error at least this is left where one light reaches.
ERROR_LEFT_BY_ONE = 0.8
# Shares of full light: what bounces into shadows, what is black there, and what a light that arrives is at least.
BOUNCED, BLACK, ARRIVING = 0.02, 0.03, 0.08
BLACK_SHADOWS = 0.7  # how many shadows are black; others have a rim of every grey
# What a light may show at most, how far from the camera a normal may turn (its z), and the least sine by which two
# lights, or one, determine a normal: below, errors would grow without bound.
FULL, FACING, LEAST_SINE = 1.02, -0.05, 0.2
# Prior shares of two lights, one light and none of all this where not all three reach.
TWO, ONE, OTHER = 0.5, 0.2, 0.3
LEAST_PRIOR = 0.02
# Pixels of the smallest object that is looked at, and by how much less lengths differ at half the resolution where
# noise is six sevenths of their variance. It would be half as much if noise were all of it.
LEAST_OBJECT, QUIETER = 1000, 0.6
# How far around a pixel others count, as a share of the object's longer side and in pixels, and how often.
AROUND, LEAST_AROUND, MOST_AROUND = 1 / 64, 2, 16
ROUNDS = 3
PAIRS = ((0, 1, 2), (0, 2, 1), (1, 2, 0))


class _Pixels(NamedTuple):
    """Pixels (...). light: (..., 3) each light alone. lights: (..., 3, 3), or (3, 3) for all; a light a row, its
    direction times its brightness. normals: (..., 3) the network's own; error: (...) what it expects of them, in
    radians."""

    light: Floats
    lights: NDArray[np.float64]
    normals: Floats
    error: Floats

    def at(self, chosen: NDArray[np.bool_], columns: slice = slice(None)) -> "_Pixels":
        """The chosen pixels of some columns of a picture."""
        lights = self.lights[:, columns][chosen] if self.lights.ndim > 2 else self.lights
        return _Pixels(
            self.light[:, columns][chosen], lights, self.normals[:, columns][chosen], self.error[:, columns][chosen]
        )


class _Hypothesis(NamedTuple):
    """normals: (N, 3) unit vectors. likelihood: (N,). error: (N,) of the normals, in radians. own: (N,) that of the
    network's. left: (N,) the least share of the network's expected error that is left."""

    normals: Floats
    likelihood: Floats
    error: Floats
    own: Floats
    left: float = 0.0


def refined(capture: Capture, estimate: NormalMap, progress: Progress = silent) -> NormalMap:
    """Normals of `capture` by a network, made exact where its photo proves a matt surface of one colour.

    Elsewhere they stay, and so they all do where there is no such proof.

    Parameters
    ----------
    capture : Capture
        The photo. Lights may be near, and the camera in perspective.
    estimate : NormalMap
        A network's normals in camera space, and its expected error as confidence: 1 for none, 0 for a right angle. Its
        arrays are overwritten.
    progress : callable
        Receives the share that is done, 0 to 1, and what is being done.
    """
    return _refined(capture, estimate, find_uniform_albedo(*_sample(capture, estimate)), progress)


def _refined(
    capture: Capture, estimate: NormalMap, albedo: UniformAlbedo | None, progress: Progress = silent
) -> NormalMap:
    """As :func:`refined`, once the albedo has been looked for.

    Where noise may hide it, or makes lengths differ, what is found at half the resolution mends the normals first.
    """
    exact = albedo is not None and albedo.spread <= LEAST_SPREAD
    if not exact and np.count_nonzero(capture.mask) > 4 * LEAST_OBJECT:
        small, before = halved(capture, estimate)
        found = find_uniform_albedo(*_sample(small, before, SAMPLED_HALVED))
        if albedo is None or (found is not None and found.spread < QUIETER * albedo.spread):
            vectors, confidence = before.vectors.copy(), before.confidence.copy()
            after = _refined(small, before, found, part(progress, 0.0, 0.2))
            mend(estimate, after, after.vectors - vectors, after.confidence - confidence)
            progress = part(progress, 0.2, 1.0)
    if albedo is None:
        return estimate
    longer = max(side.stop - side.start for side in bounding_box(capture.mask))
    around = int(np.clip(longer * AROUND, LEAST_AROUND, MOST_AROUND))
    waiting: list[tuple[slice, Floats, Floats]] = []  # of bands that others still read
    for rows, vectors, confidence in _refined_bands(capture, estimate, albedo, around):
        for done, *values in waiting:
            estimate.vectors[done], estimate.confidence[done] = values
        waiting = [(rows, vectors, confidence)]
        progress(rows.stop / len(capture.mask), "solving a matt surface of one colour")
    for done, *values in waiting:
        estimate.vectors[done], estimate.confidence[done] = values
    return estimate


def _sample(capture: Capture, estimate: NormalMap, count: int = SAMPLED) -> _Pixels:
    """About `count` pixels all over the object, with lights of their own."""
    parts = []
    for rows, chosen in sampled_rows(capture.mask, count):
        chosen &= _valid(capture, rows)
        pixels = _picture(capture, estimate, rows).at(chosen)
        parts.append(pixels._replace(lights=np.broadcast_to(pixels.lights, (len(pixels.light), 3, 3))))
    return _Pixels(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _valid(capture: Capture, rows: slice) -> NDArray[np.bool_]:
    valid: NDArray[np.bool_] = capture.mask[rows] & ~capture.saturated_in(rows).any(axis=-1)
    return valid


def _picture(capture: Capture, estimate: NormalMap, rows: slice) -> _Pixels:
    return _Pixels(
        capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False)),
        lights_in(capture, rows),
        estimate.vectors[rows].astype(np.float32),
        (1 - estimate.confidence[rows].astype(np.float32)) * np.float32(RIGHT_ANGLE),
    )


def _refined_bands(
    capture: Capture, estimate: NormalMap, albedo: UniformAlbedo, around: int
) -> Iterator[tuple[slice, Floats, Floats]]:
    """Bands of rows with their normals (h, W, 3) and confidence (h, W).

    A band reads less than a band's height of the estimate around it, so one may be written once the next is made.
    """
    height, width = capture.mask.shape
    for rows in bands(height, TILE):
        window = _grown(rows, around, height)
        results = estimate.vectors[rows].copy(), estimate.confidence[rows].copy()
        refine = partial(
            _refine_tile,
            _picture(capture, estimate, window),
            _valid(capture, window),
            slice(rows.start - window.start, rows.stop - window.start),
            albedo,
            around,
            results,
        )
        on_all_cores(refine, bands(width, TILE))
        yield rows, *results


def _grown(part: slice, around: int, length: int) -> slice:
    """With all that has a say in a part."""
    halo = (ROUNDS - 1) * around
    return slice(max(part.start - halo, 0), min(part.stop + halo, length))


def _refine_tile(
    picture: _Pixels,
    valid: NDArray[np.bool_],
    rows: slice,
    albedo: UniformAlbedo,
    around: int,
    results: tuple[Floats, Floats],
    columns: slice,
) -> None:
    """Write normals and confidence of valid pixels in some columns into the results, which are of the rows."""
    across = _grown(columns, around, valid.shape[1])
    place = valid[:, across]
    if not place.any():
        return
    normals, error = _combined(picture.at(place, across), place, albedo, around)
    tile = np.zeros((*place.shape, 4), np.float32)
    tile[place] = np.concatenate([normals, 1 - error[:, None] / RIGHT_ANGLE], axis=1)
    within = rows, slice(columns.start - across.start, columns.stop - across.start)
    inside, found = place[within], tile[within]
    vectors, confidence = (values[:, columns] for values in results)
    vectors[inside], confidence[inside] = found[inside, :3], found[inside, 3]


def _combined(pixels: _Pixels, place: NDArray[np.bool_], albedo: UniformAlbedo, around: int) -> tuple[Floats, Floats]:
    """The mean of all hypotheses: normals (N, 3) and their expected error (N,). place: (H, W) where the pixels are."""
    found = list(_hypotheses(pixels, albedo))
    rest = 1 - min(albedo.share, 0.9)
    prior = np.array([1 - rest, *[TWO * rest / 3] * 3, *[ONE * rest / 3] * 3, OTHER * rest], np.float32)
    prior = np.maximum(prior, LEAST_PRIOR)
    likelihood = np.stack([*(one.likelihood for one in found), np.ones_like(pixels.error)], axis=1)
    area = np.maximum(box_sums(place.astype(np.float32), around), 1)
    for number in range(ROUNDS):
        probability = prior * likelihood
        probability /= probability.sum(axis=1, keepdims=True)
        if number < ROUNDS - 1:
            prior = np.maximum(_means_around(probability, place, around, area), LEAST_PRIOR)
    total = pixels.normals * probability[:, -1:]
    expected = pixels.error * probability[:, -1]
    for one, share in zip(found, probability.T, strict=False):
        weight = one.own**2 / (one.own**2 + one.error**2)
        total += share[:, None] * normalised(pixels.normals + (one.normals - pixels.normals) * weight[:, None])
        expected += share * np.minimum(pixels.error, np.maximum(np.sqrt(weight) * one.error, one.left * pixels.error))
    return normalised(total), expected


def _means_around(probability: Floats, place: NDArray[np.bool_], around: int, area: NDArray[np.float64]) -> Floats:
    means = np.empty_like(probability)
    picture = np.zeros(place.shape, np.float32)
    for number in range(probability.shape[1]):
        picture[place] = probability[:, number]
        means[:, number] = (box_sums(picture, around) / area)[place]
    return means


def _hypotheses(pixels: _Pixels, albedo: UniformAlbedo) -> Iterator[_Hypothesis]:
    """All three lights reach, then two of them, then one; each likelihood as against any light from none to full."""
    strength = np.linalg.norm(pixels.lights, axis=-1)
    lights = (pixels.lights / strength[..., None]).astype(np.float32)
    light = (pixels.light * albedo.gains / strength).astype(np.float32)
    error = ERROR_OF_SPREAD * max(albedo.spread, LEAST_SPREAD) * max(1.0, (WELL_DETERMINED / albedo.determined) ** 0.5)
    own = np.maximum(SPREAD_OF_ERROR * pixels.error, 0.01)
    yield _all_three(light, lights, pixels, albedo, error, own)
    for order in PAIRS:
        yield _two(light, lights, order, pixels.normals, albedo, error, own)
    for number in range(3):
        yield _one(light, lights, number, pixels.normals, error, own)


def _all_three(
    light: Floats, lights: Floats, pixels: _Pixels, albedo: UniformAlbedo, error: float, own: Floats
) -> _Hypothesis:
    vectors = pseudo_normals(light, lights)
    length = np.linalg.norm(vectors, axis=-1)
    vectors /= np.maximum(length, 1e-6)[:, None]
    spread = max(albedo.spread, LEAST_SPREAD)
    volume = np.abs(np.linalg.det(lights))
    likelihood = _density_of_direction(_angle(vectors, pixels.normals), np.hypot(own, error))
    likelihood *= _gaussian(length - 1, spread) / volume * (light > 0).all(axis=-1)
    return _Hypothesis(vectors, likelihood, np.full_like(own, error), np.maximum(ERROR_WHERE_LIT * pixels.error, 1e-3))


def _two(
    light: Floats,
    lights: Floats,
    order: tuple[int, int, int],
    normals: Floats,
    albedo: UniformAlbedo,
    error: float,
    own: Floats,
) -> _Hypothesis:
    """The first two lights of `order` reach, the third is blocked."""
    one, two, blocked = (lights[..., number, :] for number in order)
    a, b = light[:, order[0]], light[:, order[1]]
    together = dot(one, two)
    sine = np.sqrt(np.maximum(1 - together**2, 1e-6))
    across = np.cross(one, two) / sine[..., None]
    # The part of the normal in the plane of both lights, and what is left for the direction across it.
    plane = ((a - together * b) / sine**2)[:, None] * one + ((b - together * a) / sine**2)[:, None] * two
    length = np.linalg.norm(plane, axis=-1)
    height = np.sqrt(np.maximum(1 - length**2, 0))
    side = np.where(dot(normals, across) >= 0, height, -height)
    vectors = normalised(plane + side[:, None] * across)
    steep = np.maximum(height, LEAST_SINE)
    off = np.hypot(error, BOUNCED) / steep
    likelihood = _density_of_direction(_angle(vectors, normals), np.hypot(own, off)) / (sine * steep)
    likelihood *= _density_of_blocked(light[:, order[2]], dot(vectors, blocked))
    likelihood *= np.exp(-0.5 * (np.maximum(length - 1, 0) / max(2 * albedo.spread, FULL - 1)) ** 2)
    likelihood *= (a > ARRIVING) & (b > ARRIVING) & (vectors[:, 2] > FACING)
    return _Hypothesis(vectors, likelihood, off, own)


def _one(light: Floats, lights: Floats, number: int, normals: Floats, error: float, own: Floats) -> _Hypothesis:
    """One light reaches, the others are blocked."""
    towards, cosine = lights[..., number, :], np.clip(light[:, number], 0, 1)
    away = normals - dot(normals, towards)[:, None] * towards
    away /= np.maximum(np.linalg.norm(away, axis=-1), 1e-6)[:, None]
    sine = np.sqrt(1 - cosine**2)
    vectors = normalised(cosine[:, None] * towards + sine[:, None] * away)
    steep = np.maximum(sine, LEAST_SINE)
    off = np.hypot(error, BOUNCED) / steep
    likelihood = _gaussian(_angle(vectors, normals), np.hypot(own, off)) / steep
    for other in (number + 1) % 3, (number + 2) % 3:
        full = dot(vectors, lights[..., other, :])
        likelihood *= _density_of_blocked(light[:, other], full)
    likelihood *= (light[:, number] > ARRIVING) & (light[:, number] < FULL)
    return _Hypothesis(vectors, likelihood, off, own, ERROR_LEFT_BY_ONE)


def _angle(vectors: Floats, normals: Floats) -> Floats:
    angle: Floats = 2 * np.arcsin(np.clip(np.linalg.norm(vectors - normals, axis=-1) / 2, 0, 1))
    return angle


def _gaussian(off: Floats, spread: Floats | float) -> Floats:
    density: Floats = np.exp(-0.5 * (off / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
    return density


def _density_of_direction(angle: Floats, spread: Floats) -> Floats:
    density: Floats = np.exp(-0.5 * (angle / spread) ** 2) / (2 * np.pi * spread**2)
    return density


def _density_of_blocked(light: Floats, full: Floats) -> Floats:
    """Of a blocked light's value: none of it, or a part of what it would give in full."""
    full = np.maximum(full, 0)
    black = np.exp(-0.5 * (light / BLACK) ** 2) / (BLACK * np.sqrt(np.pi / 2))
    density: Floats = BLACK_SHADOWS * black + (1 - BLACK_SHADOWS) * (light < full) / np.maximum(full, 0.05)
    return density
