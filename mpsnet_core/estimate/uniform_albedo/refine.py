"""Solve the normals of a matt surface of one colour, from the lights that reach each pixel.

Once the colour is known, the brightness of a light that reaches a pixel gives its angle to the normal. Which lights
reach it is unknown. There are seven hypotheses:

* all three lights: equation 2, whose vector must have the length of the albedo;
* two lights, with the third blocked (three hypotheses): two normals fit (Hernández et al., "Shadows in three-source
  photometric stereo", ECCV 2008), and the one closer to the network's normal is used;
* one light (three hypotheses): the normal lies on a cone, and the one closest to the network's normal is used.

An eighth stands for everything else: another material, gloss, interreflections. A hypothesis is more probable the
better it explains the pixel's values, the closer its normal is to the network's (measured by the network's expected
error), and the more probable it is at the neighbours. Each hypothesis averages its normal with the network's, weighted
by the errors of both; the result is the mean over all hypotheses.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box, box_sums
from mpsnet_core.arrays.resampling import sampled_rows
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in, pseudo_normals
from mpsnet_core.estimate.uniform_albedo.fit import MIN_SPREAD, Floats, UniformAlbedo, find_uniform_albedo
from mpsnet_core.estimate.uniform_albedo.halving import add_upsampled_changes, halve
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

RIGHT_ANGLE = np.pi / 2
# Pixels sampled to find the colour, at full and at lower resolution; side of the tiles that are processed in parallel.
SAMPLED, SAMPLED_HALVED = 10_000, 2_500
TILE = 256
# Error of equation 2 in radians per relative error of the albedo; `determined` of a fit for which this holds.
ERROR_OF_SPREAD, WELL_DETERMINED = 3.5, 0.05
# Where equation 2 holds, the error of networks is smaller than they expect, by this factor.
ERROR_WHERE_LIT = 0.65
# Standard deviation per axis of a direction whose mean error is one.
SPREAD_OF_ERROR = 0.8
# One light alone lowers the network's expected error to this share of it at most.
ERROR_LEFT_BY_ONE = 0.8
# Shares of full light: light bounced into shadows, black shadows, and the least of a light that arrives.
BOUNCED, BLACK, ARRIVING = 0.02, 0.03, 0.08
BLACK_SHADOWS = 0.7  # share of shadow pixels that are black; the others are penumbra of any grey
# Largest value of a light; how far a normal may face away from the camera (its z); least sine by which one or two
# lights determine a normal: below, errors would grow without bound.
FULL, FACING, MIN_SINE = 1.02, -0.05, 0.2
# Prior probabilities of two lights, one light and anything else, where not all three lights reach.
TWO, ONE, OTHER = 0.5, 0.2, 0.3
MIN_PRIOR = 0.02
# Pixels of the smallest object to process; factor by which the lengths' deviation falls at half the resolution if noise
# is six sevenths of their variance (0.5 if it is all of it).
MIN_OBJECT, QUIETER = 1000, 0.6
# Radius of a pixel's neighbourhood: share of the object's longer side, and limits in pixels. Rounds of inference.
AROUND, MIN_AROUND, MAX_AROUND = 1 / 64, 2, 16
ROUNDS = 3
PAIRS = ((0, 1, 2), (0, 2, 1), (1, 2, 0))


class _Pixels(NamedTuple):
    """Pixels (...) of a photo."""

    light: Floats
    """(..., 3). Unmixed image."""
    lights: NDArray[np.float64]
    """(..., 3, 3), or (3, 3) for all. Light directions times brightness, one light per row."""
    normals: Floats
    """(..., 3). The network's normals."""
    error: Floats
    """(...). Their expected error, in radians."""

    def at(self, chosen: NDArray[np.bool_], columns: slice = slice(None)) -> "_Pixels":
        """The chosen pixels of some columns of an image."""
        lights = self.lights[:, columns][chosen] if self.lights.ndim > 2 else self.lights
        return _Pixels(
            self.light[:, columns][chosen], lights, self.normals[:, columns][chosen], self.error[:, columns][chosen]
        )


class _Hypothesis(NamedTuple):
    """Normals of N pixels if certain lights reach them."""

    normals: Floats
    """(N, 3). Unit vectors."""
    likelihood: Floats
    """(N,). Likelihood of the hypothesis."""
    error: Floats
    """(N,). Error of the normals, in radians."""
    network_error: Floats
    """(N,). Error of the network's normals, in radians."""
    least_error: float = 0.0
    """Lower limit of the resulting error, as a share of the network's expected error."""


def refine_normals(capture: Capture, estimate: NormalMap, progress: Progress = silent) -> NormalMap:
    """Refine a network's normals of `capture` where the photo proves a matt surface of one colour.

    Without such a proof all normals stay as they are.

    Parameters
    ----------
    capture : Capture
        The photo. Lights may be near, and the camera a perspective one.
    estimate : NormalMap
        A network's normals in camera space, with its expected error as confidence: 1 for none, 0 for a right angle.
        Its arrays are overwritten.
    progress : callable
        Called with the share done, 0 to 1, and a message.
    """
    return _refine_normals(capture, estimate, find_uniform_albedo(*_sample(capture, estimate)), progress)


def _refine_normals(
    capture: Capture, estimate: NormalMap, albedo: UniformAlbedo | None, progress: Progress = silent
) -> NormalMap:
    """As :func:`refine_normals`, with the albedo found at this resolution.

    If noise hides the albedo, or makes the lengths differ, the normals are first corrected at half the resolution.
    """
    well_fitted = albedo is not None and albedo.spread <= MIN_SPREAD
    if not well_fitted and np.count_nonzero(capture.mask) > 4 * MIN_OBJECT:
        small, before = halve(capture, estimate)
        found = find_uniform_albedo(*_sample(small, before, SAMPLED_HALVED))
        if albedo is None or (found is not None and found.spread < QUIETER * albedo.spread):
            vectors, confidence = before.vectors.copy(), before.confidence.copy()
            after = _refine_normals(small, before, found, part(progress, 0.0, 0.2))
            add_upsampled_changes(estimate, after, after.vectors - vectors, after.confidence - confidence)
            progress = part(progress, 0.2, 1.0)
    if albedo is None:
        return estimate
    longer = max(side.stop - side.start for side in bounding_box(capture.mask))
    around = int(np.clip(longer * AROUND, MIN_AROUND, MAX_AROUND))
    waiting: list[tuple[slice, Floats, Floats]] = []  # finished bands that the next band still reads
    for rows, vectors, confidence in _refine_bands(capture, estimate, albedo, around):
        for done, *values in waiting:
            estimate.vectors[done], estimate.confidence[done] = values
        waiting = [(rows, vectors, confidence)]
        progress(rows.stop / len(capture.mask), "solving a matt surface of one colour")
    for done, *values in waiting:
        estimate.vectors[done], estimate.confidence[done] = values
    return estimate


def _sample(capture: Capture, estimate: NormalMap, count: int = SAMPLED) -> _Pixels:
    """About `count` pixels from all over the object, each with its lights."""
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


def _refine_bands(
    capture: Capture, estimate: NormalMap, albedo: UniformAlbedo, around: int
) -> Iterator[tuple[slice, Floats, Floats]]:
    """Bands of rows with their normals (h, W, 3) and confidence (h, W).

    A band reads less than one band's height around it, so a band can be written once the next one is computed.
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
    """The part and the neighbourhood that influences it."""
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
    """Write normals and confidence of the valid pixels in some columns into `results`, which hold the rows."""
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
    """Mean over all hypotheses: normals (N, 3) and their expected error (N,). place: (H, W) mask of the pixels."""
    found = list(_hypotheses(pixels, albedo))
    rest = 1 - min(albedo.share, 0.9)
    prior = np.array([1 - rest, *[TWO * rest / 3] * 3, *[ONE * rest / 3] * 3, OTHER * rest], np.float32)
    prior = np.maximum(prior, MIN_PRIOR)
    likelihood = np.stack([*(one.likelihood for one in found), np.ones_like(pixels.error)], axis=1)
    area = np.maximum(box_sums(place.astype(np.float32), around), 1)
    for number in range(ROUNDS):
        probability = prior * likelihood
        probability /= probability.sum(axis=1, keepdims=True)
        if number < ROUNDS - 1:
            prior = np.maximum(_means_around(probability, place, around, area), MIN_PRIOR)
    total = pixels.normals * probability[:, -1:]
    expected = pixels.error * probability[:, -1]
    for one, share in zip(found, probability.T, strict=False):
        weight = one.network_error**2 / (one.network_error**2 + one.error**2)
        total += share[:, None] * normalised(pixels.normals + (one.normals - pixels.normals) * weight[:, None])
        expected += share * np.minimum(
            pixels.error, np.maximum(np.sqrt(weight) * one.error, one.least_error * pixels.error)
        )
    return normalised(total), expected


def _means_around(probability: Floats, place: NDArray[np.bool_], around: int, area: NDArray[np.float64]) -> Floats:
    means = np.empty_like(probability)
    picture = np.zeros(place.shape, np.float32)
    for number in range(probability.shape[1]):
        picture[place] = probability[:, number]
        means[:, number] = (box_sums(picture, around) / area)[place]
    return means


def _hypotheses(pixels: _Pixels, albedo: UniformAlbedo) -> Iterator[_Hypothesis]:
    """Three lights reach, then two, then one. Likelihoods are relative to light uniform between none and full."""
    strength = np.linalg.norm(pixels.lights, axis=-1)
    lights = (pixels.lights / strength[..., None]).astype(np.float32)
    light = (pixels.light * albedo.gains / strength).astype(np.float32)
    error = ERROR_OF_SPREAD * max(albedo.spread, MIN_SPREAD) * max(1.0, (WELL_DETERMINED / albedo.determined) ** 0.5)
    network_error = np.maximum(SPREAD_OF_ERROR * pixels.error, 0.01)
    yield _all_three(light, lights, pixels, albedo, error, network_error)
    for order in PAIRS:
        yield _two(light, lights, order, pixels.normals, albedo, error, network_error)
    for number in range(3):
        yield _one(light, lights, number, pixels.normals, error, network_error)


def _all_three(
    light: Floats, lights: Floats, pixels: _Pixels, albedo: UniformAlbedo, error: float, network_error: Floats
) -> _Hypothesis:
    vectors = pseudo_normals(light, lights)
    length = np.linalg.norm(vectors, axis=-1)
    vectors /= np.maximum(length, 1e-6)[:, None]
    spread = max(albedo.spread, MIN_SPREAD)
    volume = np.abs(np.linalg.det(lights))
    likelihood = _density_of_direction(_angle(vectors, pixels.normals), np.hypot(network_error, error))
    likelihood *= _gaussian(length - 1, spread) / volume * (light > 0).all(axis=-1)
    return _Hypothesis(
        vectors, likelihood, np.full_like(network_error, error), np.maximum(ERROR_WHERE_LIT * pixels.error, 1e-3)
    )


def _two(
    light: Floats,
    lights: Floats,
    order: tuple[int, int, int],
    normals: Floats,
    albedo: UniformAlbedo,
    error: float,
    network_error: Floats,
) -> _Hypothesis:
    """The first two lights of `order` reach; the third is blocked."""
    one, two, blocked = (lights[..., number, :] for number in order)
    a, b = light[:, order[0]], light[:, order[1]]
    together = dot(one, two)
    sine = np.sqrt(np.maximum(1 - together**2, 1e-6))
    across = np.cross(one, two) / sine[..., None]
    # The normal's component in the plane of both lights; its unit length gives the component perpendicular to it.
    plane = ((a - together * b) / sine**2)[:, None] * one + ((b - together * a) / sine**2)[:, None] * two
    length = np.linalg.norm(plane, axis=-1)
    height = np.sqrt(np.maximum(1 - length**2, 0))
    side = np.where(dot(normals, across) >= 0, height, -height)
    vectors = normalised(plane + side[:, None] * across)
    steep = np.maximum(height, MIN_SINE)
    off = np.hypot(error, BOUNCED) / steep
    likelihood = _density_of_direction(_angle(vectors, normals), np.hypot(network_error, off)) / (sine * steep)
    likelihood *= _density_of_blocked(light[:, order[2]], dot(vectors, blocked))
    likelihood *= np.exp(-0.5 * (np.maximum(length - 1, 0) / max(2 * albedo.spread, FULL - 1)) ** 2)
    likelihood *= (a > ARRIVING) & (b > ARRIVING) & (vectors[:, 2] > FACING)
    return _Hypothesis(vectors, likelihood, off, network_error)


def _one(
    light: Floats, lights: Floats, number: int, normals: Floats, error: float, network_error: Floats
) -> _Hypothesis:
    """One light reaches; the others are blocked."""
    towards, cosine = lights[..., number, :], np.clip(light[:, number], 0, 1)
    away = normals - dot(normals, towards)[:, None] * towards
    away /= np.maximum(np.linalg.norm(away, axis=-1), 1e-6)[:, None]
    sine = np.sqrt(1 - cosine**2)
    vectors = normalised(cosine[:, None] * towards + sine[:, None] * away)
    steep = np.maximum(sine, MIN_SINE)
    off = np.hypot(error, BOUNCED) / steep
    likelihood = _gaussian(_angle(vectors, normals), np.hypot(network_error, off)) / steep
    for other in (number + 1) % 3, (number + 2) % 3:
        full = dot(vectors, lights[..., other, :])
        likelihood *= _density_of_blocked(light[:, other], full)
    likelihood *= (light[:, number] > ARRIVING) & (light[:, number] < FULL)
    return _Hypothesis(vectors, likelihood, off, network_error, ERROR_LEFT_BY_ONE)


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
    """Probability density of a blocked light's value: black, or penumbra between none and full light."""
    full = np.maximum(full, 0)
    black = np.exp(-0.5 * (light / BLACK) ** 2) / (BLACK * np.sqrt(np.pi / 2))
    density: Floats = BLACK_SHADOWS * black + (1 - BLACK_SHADOWS) * (light < full) / np.maximum(full, 0.05)
    return density
