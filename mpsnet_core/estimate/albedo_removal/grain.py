"""Remove grain: albedo of one chromaticity that varies in brightness, as of stone, plaster, paper and cloth.

Equation 2 is invariant to grain, because it scales all three channels alike. To a network that has learned shape from
shading, grain may look like relief. So if a photo proves that its surface is matt and of one chromaticity, each pixel
is divided by its albedo relative to the mean, which is the length of equation 2's vector. The proof has three parts:

* with the gains that make these lengths as equal as possible, they do not depend on the direction: the surface is matt;
* with these gains, the gradients of equation 2's normals have no curl: they belong to a surface. With several colours,
  each edge between them has curl;
* most lengths are near their mean.

Deep shadows and highlights are not grain and do not change.
"""

from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.gradient_derivatives import gradient_derivatives
from mpsnet_core.arrays.resampling import means_inside, sampled_rows
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.statistics import TUKEY, biweight, deviation
from mpsnet_core.arrays.types import F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.albedos import ROWS, SAMPLED, divide_out_albedo
from mpsnet_core.estimate.distant_lights import lights_in, pseudo_normals, pseudo_normals_by_light

MIN_PIXELS = 2_000
DIM = 0.15  # share of a light's median below which it may be blocked
DARKEST = 1e-6  # keeps logarithms finite
ROUNDS, ENOUGH = 30, 1e-4
PRIOR = 1e-3  # weight of the assumption that the surface faces the camera, if lengths do not determine its colour
# Standard deviation of the log length on a surface with grain. Less does not disturb the solver of matt surfaces; more
# is a pattern rather than grain.
MIN_GRAIN, MAX_GRAIN = 0.02, 0.3
# Conditions of the proof: the part of that deviation that the direction explains, absolute and as a share,
MAX_BY_DIRECTION, MAX_EXPLAINED = 0.006, 0.1
# the smaller of the two eigenvalues of the fit's normal equations that distinguish colours, per pixel,
DETERMINED = 0.003
# the share of pixels that count in the fit,
MIN_SHARE = 0.85
# and the curl relative to random gradients, at the scale where it is smallest, on at least so many cells.
MAX_CURL, MIN_CELLS = 0.035, 400
# Instead of the curl: a standard deviation of directions, in radians, below which the surface is flat and has one tint.
FLAT = 0.035
# The curl is measured on at most this many pixels, on this many scales.
MAX_PIXELS, SCALES = 1 << 18, 5
MIN_FACING = 0.3  # least z of normals whose gradients are used
# The deviation of lengths to leave, per radian of noise in the normals: the solver of matt surfaces takes from it how
# exact equation 2 is. The deviation must be this many times the noise; else it may be noise itself.
LEFT_BY_NOISE, MIN_LEFT, ABOVE_NOISE = 1 / 3.5, 0.003, 1.6


@dataclass(frozen=True)
class Grain:
    """Fit of a surface of one chromaticity with varying brightness."""

    gains: F64
    """(3,) float64. Gains times unmixed light is each light's cosine times the albedo relative to the mean."""
    deviation: float
    """Standard deviation of the log relative albedo."""
    by_direction: float
    """The part of the deviation that the direction of the normal explains."""
    determined: float
    """The second of three eigenvalues of the fit's normal equations, per pixel."""
    share: float
    """Share of the pixels that count in the fit."""
    direction_spread: float
    """Standard deviation of equation 2's directions, in radians."""
    curl: float = np.inf
    """Curl of equation 2's gradients, relative to random gradients."""
    noise: float = 0.0
    """Standard deviation of the noise in equation 2's normals, in radians, from differences of neighbours."""


def divide_out_grain(capture: Capture) -> Capture:
    """The capture as if its surface had one albedo; unchanged if the photo does not prove grain of one chromaticity.

    Lights may be near. Each channel of the result is one light alone. Normals by equation 2 do not change.
    """
    grain = find_grain(capture)
    if grain is None:
        return capture
    share = 1 - max(LEFT_BY_NOISE * grain.noise, MIN_LEFT) / grain.deviation

    def factors(rows: slice) -> tuple[Floats, Floats]:
        light, vectors, usable = _equation_2(capture, rows, grain.gains)
        brightness = np.log(np.maximum(np.linalg.norm(vectors, axis=-1), DARKEST))
        # Remove usual deviations fully, large ones in part, shadows not at all.
        brightness *= share * usable * biweight(brightness, 2 * grain.deviation) ** 0.5
        return light, np.exp(brightness)[..., None]

    return divide_out_albedo(capture, factors)


def find_grain(capture: Capture) -> Grain | None:
    """A surface's chromaticity and grain, or None if the photo does not prove them."""
    grain = _fit(capture)
    if (
        grain is None
        or not MIN_GRAIN < grain.deviation < MAX_GRAIN
        or grain.by_direction > min(MAX_BY_DIRECTION, MAX_EXPLAINED * grain.deviation)
        or grain.share < MIN_SHARE
    ):
        return None
    flat = grain.direction_spread < FLAT
    if not flat and grain.determined < DETERMINED:
        return None
    grain = _with_curl(capture, grain)
    proven = grain.deviation > ABOVE_NOISE * grain.noise and (flat or grain.curl < MAX_CURL)
    return grain if proven else None


def _equation_2(capture: Capture, rows: slice, gains: F64) -> tuple[Floats, F64, Bools]:
    """For some rows: the unmixed image (h, W, 3), equation 2's vectors (h, W, 3), and whether they count (h, W)."""
    light = capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))
    usable = capture.mask[rows] & (light > 0).all(axis=-1) & ~capture.saturated_in(rows).any(axis=-1)
    return light, pseudo_normals(light * gains, lights_in(capture, rows)), usable


def _fit(capture: Capture) -> Grain | None:
    light, lights = _sample(capture)
    if len(light) < MIN_PIXELS:
        return None
    parts = pseudo_normals_by_light(light, lights)
    gains = facing = np.median(lights[..., 2], axis=0) / np.median(light, axis=0)  # of a surface that faces the camera
    for _ in range(ROUNDS):
        vectors = np.einsum("k,nki->ni", gains, parts)
        length = np.linalg.norm(vectors, axis=-1)
        brightness = np.log(length)
        brightness -= np.median(brightness)
        weight = biweight(brightness, deviation(brightness, 0.01))
        weight /= weight.sum()
        gradient = np.einsum("ni,nki->nk", vectors, parts) * gains / (length**2)[:, None]
        gradient -= weight @ gradient
        mean = float(weight @ np.log(length))
        equations = (gradient * weight[:, None]).T @ gradient
        away = np.log(gains / facing)
        error = (gradient * weight[:, None]).T @ (np.log(length) - mean) + PRIOR * (away - away.mean())
        change = -np.linalg.solve(equations + PRIOR * np.eye(3), error)
        change -= change.mean()
        gains = gains * np.exp(np.clip(change, -0.2, 0.2) - mean)
        if np.abs(change).max() < ENOUGH:
            break
    directions = vectors / length[:, None]
    x, y = directions[:, :2].T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1) * np.sqrt(weight)[:, None]
    explained = terms @ np.linalg.lstsq(terms, brightness * np.sqrt(weight), rcond=None)[0]
    explained -= np.sqrt(weight) * float(np.sqrt(weight) @ explained)
    by_direction, determined = float(np.linalg.norm(explained)), float(np.linalg.eigvalsh(equations)[1])
    spread = float(np.sqrt(weight @ np.square(directions - weight @ directions).sum(axis=-1)))
    return Grain(gains, deviation(brightness), by_direction, determined, float((weight > 0).mean()), spread)


def _sample(capture: Capture) -> tuple[Floats, Floats]:
    """(N, 3) unmixed pixels from all over the object that all three lights seem to reach, and (N, 3, 3) the lights
    there."""
    light, lights = [], []
    for rows, chosen in sampled_rows(capture.mask, SAMPLED):
        chosen = chosen & ~capture.saturated_in(rows).any(axis=-1)
        light.append(capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))[chosen])
        lights.append(np.broadcast_to(lights_in(capture, rows), (*chosen.shape, 3, 3))[chosen])
    values, towards = np.concatenate(light).astype(np.float64), np.concatenate(lights)
    if not len(values):
        return values, towards
    reached = (values > DIM * np.maximum(np.median(values, axis=0), 1e-12)).all(axis=-1)
    return values[reached], towards[reached]


def _with_curl(capture: Capture, grain: Grain) -> Grain:
    """Add the curl at the best of all scales, and the noise at the finest."""
    halvings = 0
    while capture.mask.size >> 2 * halvings > MAX_PIXELS:
        halvings += 1
    vectors, usable = [], []
    for rows in bands(len(capture.mask), ROWS << halvings):
        _, found, counts = _equation_2(capture, rows, grain.gains)
        length = np.linalg.norm(found, axis=-1)
        counts &= np.abs(np.log(np.maximum(length, DARKEST))) < TUKEY * grain.deviation
        some, whole = _halved(found, counts, halvings)
        vectors.append(some)
        usable.append(whole)
    field, counts = np.concatenate(vectors), np.concatenate(usable)
    curls, noise = [np.inf], 0.0
    for scale in range(SCALES):
        if scale:
            field, counts = _halved(field, counts, 1)
        along_x, along_y = gradient_derivatives(normalised(field), counts, MIN_FACING)
        if len(along_x) < MIN_CELLS:
            break
        curl = float(np.square(along_y[:, 0] - along_x[:, 1]).mean())
        if scale == 0:  # the curl has twice the normals' variance; each halving averages four and halves the noise
            noise = float(np.sqrt(curl / 2)) * 2**halvings
        curls.append(2 * curl / max(float(np.square([along_x, along_y]).sum(axis=(0, 2)).mean()), 1e-12))
    return replace(grain, curl=min(curls), noise=noise)


def _halved(field: Floats, counts: Bools, halvings: int) -> tuple[Floats, Bools]:
    """Means over blocks, and whether every pixel of a block counts."""
    values = np.concatenate([field, counts[..., None]], axis=-1, dtype=np.float32)
    means, _ = means_inside(values, np.ones_like(counts), halvings)
    return means[..., :3], means[..., 3] > 0.999
