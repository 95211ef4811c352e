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
by the errors of both. The result is the mean over all hypotheses, which leans to the most probable one: the error that
counts is the angle, not its square.

Interreflections add light to every channel, and a channel whose light is blocked shows how much. So the fewer lights
reach a pixel, the better the photo tells how far its values can be trusted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box, box_sums
from mpsnet_core.arrays.resampling import means_inside, sampled_rows, upsampled
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in, pseudo_normals, pseudo_normals_by_light
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

# --- test whether a photo shows a matt surface of one albedo, and find that albedo ------------------------------------
# Equation 2 gives a vector for every pixel whose length is the albedo. If a matt surface has one colour and all three
# lights reach it, all vectors have the same length once each channel is divided by that colour: the pixels lie on an
# ellipsoid (Drew and Kontsevich, "Closed-form attitude determination under spectrally varying illumination", CVPR
# 1994). A robust fit finds the colour, and the lengths prove it: pixels with other colours, gloss or shadows lie on the
# ellipsoid only by chance.


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

    gains: F64
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


def find_uniform_albedo(light: Floats, lights: F64, normals: Floats, expected_error: Floats) -> UniformAlbedo | None:
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
            right = np.einsum("nk,n->k", gradient, weights * (1 - length)) / total
            change = np.linalg.solve(equations + 1e-4 * np.eye(3), right)
            gains = gains * np.exp(np.clip(change, -0.3, 0.3))
        if number == len(spreads) - 1 and len(spreads) < len(SPREADS) + FURTHER_SPREADS:
            length = _weighed(parts, gains, normals, nearby, spread)[0]
            centre, found = _peak(length[positive], 2 * spread)
            if found < 0.6 * spread:
                gains /= centre
                spreads.append(max(2 * found, MIN_SPREAD))
    length, vectors, weights = _weighed(parts, gains, normals, nearby, spread)
    length = np.where(positive, length, 0)
    spread, determined = _peak(length, 2 * SPREADS[-1])[1], float(np.linalg.eigvalsh(equations)[0])
    density = max((_density(length, 0.8, 0.9) + _density(length, 1.1, 1.2)) / 2, MIN_DENSITY)
    share = float((np.abs(length - 1) < 2 * SPREADS[-1]).mean())
    result = UniformAlbedo(gains, spread, determined, density, share)
    proven = result.sharp(_density(length, 0.98, 1.02)) and _directions(vectors, weights * positive) > DIRECTIONS
    return result if proven else None


def _weighed(parts: Floats, gains: F64, normals: Floats, nearby: Floats, spread: float) -> tuple[F64, F64, F64]:
    """Length (N,) and direction (N, 3) of equation 2's vectors, and the pixels' weights (N,)."""
    vectors = np.einsum("k,nki->ni", gains, parts)
    length = _length(vectors)
    vectors /= np.maximum(length, 1e-9)[:, None]
    off = _length(vectors - normals) / nearby
    return length, vectors, np.exp(-0.5 * (((length - 1) / spread) ** 2 + off**2))


def _peak(length: F64, within: float) -> tuple[float, float]:
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


def _density(length: F64, low: float, high: float) -> float:
    return float(((length > low) & (length < high)).mean() / (high - low))


def _directions(vectors: F64, weights: F64) -> float:
    """Effective number of directions: the perplexity of their histogram over x and y."""
    sure = weights > 0.3
    cells = np.floor(vectors[sure, :2] / DIRECTION_STEP).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    counts = np.bincount(cell.reshape(-1), weights[sure])
    counts = np.minimum(counts, LARGEST_FACE * len(weights))
    shares = counts / max(counts.sum(), 1e-9)
    return float(np.exp(-(shares * np.log(shares)).sum())) if len(shares) else 0.0


# --- halve the resolution of a photo and its normals, and correct the normals by what was found there -----------------
# Noise can hide that a surface has one albedo. The mean of four pixels has half the noise.


# Rows at a time; even, because pairs of rows are averaged.
ROWS = 256
# Share of the confidence gained at half the resolution that counts at full: finer relief may still be wrong.
SURE = 0.8


def halve(capture: Capture, estimate: NormalMap) -> tuple[Capture, NormalMap]:
    """Both at half the resolution: each pixel is the mean of those inside the mask, and clipped if one of them is."""
    shape = tuple(-(-side // 2) for side in capture.mask.shape)
    image = np.zeros((*shape, 3), capture.image.dtype)
    normals = np.zeros((*shape, 4), estimate.vectors.dtype)
    mask, clipped = np.zeros(shape, bool), np.zeros((*shape, 3), bool)
    camera, depth = capture.camera, None if capture.depth is None else np.zeros(shape, np.float32)
    for rows in bands(len(capture.mask), ROWS):
        half, inside = slice(rows.start // 2, -(-rows.stop // 2)), capture.mask[rows]
        image[half], mask[half] = means_inside(capture.image[rows].astype(np.float32, copy=False), inside, 1)
        found = np.concatenate([estimate.vectors[rows], estimate.confidence[rows][..., None]], axis=-1)
        normals[half] = means_inside(found.astype(np.float32, copy=False), inside, 1)[0]
        clipped[half] = means_inside(capture.saturated_in(rows).astype(np.float32), inside, 1)[0] > 0
        if depth is not None and capture.depth is not None:
            known = np.where(inside, capture.depth[rows], np.float32(0))[..., None]
            depth[half] = means_inside(known, inside, 1)[0][..., 0]
    if camera is not None:
        camera = camera.cropped(0, 0, camera.width, camera.height, 2)
    small = Capture(image, mask, capture.rig, camera, depth=depth, clipped=clipped)
    return small, NormalMap(normals[..., :3], mask, normals[..., 3], in_place=True)


def add_upsampled_changes(estimate: NormalMap, half: NormalMap, turn: Floats, trust: Floats) -> None:
    """Add the changes found at half the resolution, in place: `turn` (h, w, 3) to the normals and `trust` (h, w) to
    the confidence, bilinearly from the pixels inside the mask of `half`."""
    if not (turn.any() or trust.any()):
        return
    change = np.concatenate([turn, trust[..., None], half.mask[..., None]], axis=-1, dtype=np.float32)
    height, width = estimate.mask.shape
    for rows in bands(height, ROWS):
        full = upsampled(change, (2 * len(change), 2 * change.shape[1]), rows)[:, :width]
        full = full[..., :4] / np.maximum(full[..., 4:], np.float32(1e-3))
        mask, vectors, confidence = estimate.mask[rows], estimate.vectors[rows], estimate.confidence[rows]
        vectors[mask] = normalised(vectors + full[..., :3])[mask]
        confidence[mask] = np.clip(confidence + SURE * full[..., 3], 0, 1)[mask]


RIGHT_ANGLE = np.pi / 2
# Pixels sampled to find the colour, at full and at lower resolution; side of the tiles that are processed in parallel.
SAMPLED, SAMPLED_HALVED = 10_000, 2_500
TILE = 256
# Error of equation 2 in radians per relative error of the albedo; the least error; `determined` of a fit for which this
# holds.
ERROR_OF_SPREAD, LEAST_ERROR, WELL_DETERMINED = 3.5, 0.0035, 0.05
# Where equation 2 holds, the error of networks is smaller than they expect, by this factor.
ERROR_WHERE_LIT = 0.65
# Standard deviation per axis of a direction whose mean error is one.
SPREAD_OF_ERROR = 0.8
# One light alone lowers the network's expected error to this share of it at most.
ERROR_LEFT_BY_ONE = 0.8
# Error of a channel by bounced light, per light in the blocked ones, and at least, as a share of full light.
BOUNCED, LEAST_BOUNCED = 2.0, 0.004
# Shares of full light: black shadows, and the least of a light that arrives.
BLACK, ARRIVING = 0.03, 0.08
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
LEAN = 2  # power of the hypotheses' probabilities in the mean of their normals
# Radius of a pixel's neighbourhood: share of the object's longer side, and limits in pixels. Rounds of inference.
AROUND, MIN_AROUND, MAX_AROUND = 1 / 64, 2, 16
ROUNDS = 3
PAIRS = ((0, 1, 2), (0, 2, 1), (1, 2, 0))


class _Pixels(NamedTuple):
    """Pixels (...) of a photo."""

    light: Floats
    """(..., 3). Unmixed image."""
    lights: F64
    """(..., 3, 3), or (3, 3) for all. Light directions times brightness, one light per row."""
    normals: Floats
    """(..., 3). The network's normals."""
    error: Floats
    """(...). Their expected error, in radians."""

    def at(self, chosen: Bools, columns: slice = slice(None)) -> "_Pixels":
        """The chosen pixels of some columns of an image."""
        lights = self.lights[:, columns][chosen] if self.lights.ndim > 2 else self.lights
        light, normals, error = (one[:, columns][chosen] for one in (self.light, self.normals, self.error))
        return _Pixels(light, lights, normals, error)


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


def _valid(capture: Capture, rows: slice) -> Bools:
    return capture.mask[rows] & ~capture.saturated_in(rows).any(axis=-1)


def _picture(capture: Capture, estimate: NormalMap, rows: slice) -> _Pixels:
    light = capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))
    error = (1 - estimate.confidence[rows].astype(np.float32)) * np.float32(RIGHT_ANGLE)
    return _Pixels(light, lights_in(capture, rows), estimate.vectors[rows].astype(np.float32), error)


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
        pixels, valid = _picture(capture, estimate, window), _valid(capture, window)
        own = slice(rows.start - window.start, rows.stop - window.start)
        on_all_cores(partial(_refine_tile, pixels, valid, own, albedo, around, results), bands(width, TILE))
        yield rows, *results


def _grown(part: slice, around: int, length: int) -> slice:
    """The part and the neighbourhood that influences it."""
    halo = (ROUNDS - 1) * around
    return slice(max(part.start - halo, 0), min(part.stop + halo, length))


def _refine_tile(
    picture: _Pixels,
    valid: Bools,
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


def _combined(pixels: _Pixels, place: Bools, albedo: UniformAlbedo, around: int) -> tuple[Floats, Floats]:
    """Mean over all hypotheses: normals (N, 3) and their expected error (N,). place: (H, W) mask of the pixels."""
    found = list(_hypotheses(pixels, albedo))
    rest = 1 - min(albedo.share, 0.9)
    prior = np.array([1 - rest, *[TWO * rest / 3] * 3, *[ONE * rest / 3] * 3, OTHER * rest], np.float32)
    prior = np.maximum(prior, MIN_PRIOR)[:, None]
    likelihood = np.stack([*(one.likelihood for one in found), np.ones_like(pixels.error)])
    area = np.maximum(box_sums(place, around)[place], 1)
    for number in range(ROUNDS):
        probability = prior * likelihood
        probability /= probability.sum(axis=0)
        if number < ROUNDS - 1:
            prior = np.maximum(_means_around(probability, place, around, area), MIN_PRIOR)
    shares = probability**LEAN
    shares /= shares.sum(axis=0)
    total = pixels.normals * shares[-1][:, None]
    expected = pixels.error * probability[-1]
    for one, share, chance in zip(found, shares, probability, strict=False):
        weight = one.network_error**2 / (one.network_error**2 + one.error**2)
        total += share[:, None] * normalised(pixels.normals + (one.normals - pixels.normals) * weight[:, None])
        expected += chance * np.minimum(
            pixels.error, np.maximum(np.sqrt(weight) * one.error, one.least_error * pixels.error)
        )
    return normalised(total), expected


def _means_around(probability: Floats, place: Bools, around: int, area: F64) -> Floats:
    means = np.empty_like(probability)
    picture = np.zeros(place.shape, np.float32)
    for mean, one in zip(means, probability, strict=True):
        picture[place] = one
        mean[:] = box_sums(picture, around)[place] / area
    return means


def _hypotheses(pixels: _Pixels, albedo: UniformAlbedo) -> Iterator[_Hypothesis]:
    """Three lights reach, then two, then one. Likelihoods are relative to light uniform between none and full."""
    strength = _length(pixels.lights)
    lights = (pixels.lights / strength[..., None]).astype(np.float32)
    light = (pixels.light * albedo.gains / strength).astype(np.float32)
    error = max(ERROR_OF_SPREAD * albedo.spread, LEAST_ERROR) * max(1.0, (WELL_DETERMINED / albedo.determined) ** 0.5)
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
    length = _length(vectors)
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
    length = _length(plane)
    height = np.sqrt(np.maximum(1 - length**2, 0))
    side = np.where(dot(normals, across) >= 0, height, -height)
    vectors = normalised(plane + side[:, None] * across)
    steep = np.maximum(height, MIN_SINE)
    off = np.hypot(error, _bounced(light[:, order[2]])) / steep
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
    away /= np.maximum(_length(away), 1e-6)[:, None]
    sine = np.sqrt(1 - cosine**2)
    vectors = normalised(cosine[:, None] * towards + sine[:, None] * away)
    steep = np.maximum(sine, MIN_SINE)
    others = [(number + 1) % 3, (number + 2) % 3]
    off = np.hypot(error, _bounced(light[:, others].mean(axis=-1))) / steep
    likelihood = _gaussian(_angle(vectors, normals), np.hypot(network_error, off)) / steep
    for other in others:
        full = dot(vectors, lights[..., other, :])
        likelihood *= _density_of_blocked(light[:, other], full)
    likelihood *= (light[:, number] > ARRIVING) & (light[:, number] < FULL)
    return _Hypothesis(vectors, likelihood, off, network_error, ERROR_LEFT_BY_ONE)


def _bounced(blocked: Floats) -> Floats:
    """Error of a channel by bounced light, from the light in channels whose own light is blocked."""
    return np.maximum(BOUNCED * blocked, LEAST_BOUNCED)


def _length(vectors: Floats) -> Floats:
    """(...) lengths of vectors (..., 3), several times as fast as NumPy's norm."""
    return np.sqrt(dot(vectors, vectors))


def _angle(vectors: Floats, normals: Floats) -> Floats:
    return 2.0 * np.arcsin(np.clip(_length(vectors - normals) / 2, 0, 1))


def _gaussian(off: Floats, spread: Floats | float) -> Floats:
    return np.exp(-0.5 * (off / spread) ** 2) / (spread * np.sqrt(2 * np.pi))


def _density_of_direction(angle: Floats, spread: Floats) -> Floats:
    return np.exp(-0.5 * (angle / spread) ** 2) / (2 * np.pi * spread**2)


def _density_of_blocked(light: Floats, full: Floats) -> Floats:
    """Probability density of a blocked light's value: black, or penumbra between none and full light."""
    full = np.maximum(full, 0)
    black = np.exp(-0.5 * (light / BLACK) ** 2) / (BLACK * np.sqrt(np.pi / 2))
    return BLACK_SHADOWS * black + (1 - BLACK_SHADOWS) * (light < full) / np.maximum(full, 0.05)
