"""Reflected direct light: reflectance averaged over a light's disc, because large lights widen highlights.

The albedo and highlight width of each reflectance decide where the average needs more than the light's centre.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.synthesis.reflectance import Reflectance
from mpsnet_core.synthesis.shading.directions import disc
from mpsnet_core.synthesis.shading.lights import TURNS, Light

# Lights up to this share of the highlight's width are evaluated at their centre ...
POINT_LIKE = 0.35
# ... and up to this one at three points, which average any quadratic function over a disc exactly.
SMALL = 1.0
# Larger lights use this many samples on the light's disc, and in the lobe about the mirror direction.
DISC_POINTS, LOBE_POINTS = 12, 12
# Beyond this many widths from the mirror direction, the centre is sufficient for small and for large lights.
SMALL_REACH, REACH = 3.0, 6.0
# The direction to a light whose centre is just below the horizon is lifted to this cosine.
MIN_COSINE = 0.02
# Angles from the normal at which reflectance is measured, denser at the highlight's peak.
_ANGLES = (np.arange(96) + 0.5) / 96
_ANGLES, _STEPS = np.pi / 2 * _ANGLES**3, np.pi / 2 * 3 * _ANGLES**2 / 96


@dataclass(frozen=True)
class Lobe:
    """Properties of a reflectance at normal incidence."""

    albedo: NDArray[np.float32]
    """(3,) float32. Directional albedo."""
    width: float
    """Angle in radians at which the highlight falls to a half, infinite if there is none."""


def lobe(reflectance: Reflectance) -> Lobe:
    """Measure the albedo and highlight width of a reflectance."""
    up = np.tile(np.array([0, 0, 1], np.float32), (len(_ANGLES), 1))
    around = np.stack([np.sin(_ANGLES), 0 * _ANGLES, np.cos(_ANGLES)], axis=1).astype(np.float32)
    profile = reflectance(up, around, up, None).astype(np.float64)
    albedo = 2 * np.pi * (profile.T @ (np.sin(_ANGLES) * np.cos(_ANGLES) * _STEPS))
    mean = profile.mean(axis=1)
    matt = np.interp(np.pi / 3, _ANGLES, mean)
    peak = mean[0] - matt
    if peak <= 0.1 * matt:
        return Lobe(np.minimum(albedo, 1).astype(np.float32), np.inf)
    return Lobe(np.minimum(albedo, 1).astype(np.float32), float(_ANGLES[np.argmax(mean - matt < peak / 2)]))


def reflect_light(
    reflectance: Reflectance,
    width: float,
    light: Light,
    normals: NDArray[np.float32],
    views: NDArray[np.float32],
    paint: NDArray[np.float32] | None,
    turns: NDArray[np.integer[Any]],
) -> NDArray[np.float32]:
    """(N, 3) radiance of points under an unoccluded light, divided by irradiance; 1 for a white matt surface.

    normals, views: (N, 3) unit vectors. paint: (N, 3) or None. width: of the reflectance's lobe. turns: (N,) integers
    below TURNS that rotate the samples.
    """
    middle = light.direction.astype(np.float32)
    cosine = normals @ middle
    radius = light.radius
    result: NDArray[np.float32] = np.pi * reflectance(normals, _above(normals, middle, cosine), views, paint)
    if radius <= POINT_LIKE * width:
        return result
    mirrored = (2 * dot(normals, views))[:, None] * normals - views
    along = mirrored @ middle
    # Intersection of the mirror direction with the disc's plane, in units of its radius.
    mirror = mirrored @ (light.axes.T / radius).astype(np.float32)
    mirror /= np.maximum(along, 0.1)[:, None]
    small, spread = radius <= SMALL * width, width / radius
    reach = 1 + (SMALL_REACH if small else REACH) * spread
    near = np.flatnonzero((along > 0.1) & (np.hypot(*mirror.T) < reach) & (cosine > 0))
    if not len(near):
        return result
    normals, views, mirror = (vectors.take(near, axis=0) for vectors in (normals, views, mirror))
    turns = turns[near]
    paint = None if paint is None else paint.take(near, axis=0)
    total, shares = np.zeros((len(near), 3), np.float32), np.zeros((len(near), 1), np.float32)
    for places, weights in _three(turns) if small else _many(mirror, np.float32(spread), turns):
        towards = light.direction.astype(np.float32) + (places * np.float32(radius)) @ light.axes.astype(np.float32)
        towards /= np.sqrt(dot(towards, towards))[:, None]
        share = (np.maximum(dot(normals, towards), 0) * weights)[:, None]
        used = np.flatnonzero(share)
        some = None if paint is None else paint[used]
        total[used] += share[used] * reflectance(normals[used], towards[used], views[used], some)
        shares += share
    result[near] = np.pi * total / np.maximum(shares, 1e-6)
    return result


def _above(
    normals: NDArray[np.float32], middle: NDArray[np.float32], cosine: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(N, 3) directions to the light's centre, lifted above the horizon."""
    towards = np.broadcast_to(middle, normals.shape)
    below = np.flatnonzero(cosine < MIN_COSINE)
    if len(below):
        towards = towards.copy()
        towards[below] += (np.float32(MIN_COSINE) - cosine[below])[:, None] * normals[below]
        towards[below] /= np.sqrt(dot(towards[below], towards[below]))[:, None]
    return towards


Places = Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]
"""Point after point of a disc: where (N, 2), its rim the unit circle, and with which weight (N,) or () for all."""


def _three(turns: NDArray[np.integer[Any]]) -> Places:
    angles = 2 * np.pi * (np.arange(TURNS) / TURNS + np.arange(3)[:, None]) / 3
    for places in (np.stack([np.cos(angles), np.sin(angles)], axis=-1) / np.sqrt(2)).astype(np.float32):
        yield places[turns], np.array(1 / 3, np.float32)


def _many(mirror: NDArray[np.float32], spread: np.float32, turns: NDArray[np.integer[Any]]) -> Places:
    """Samples of the disc and of the lobe, combined by the balance heuristic (Veach 1997).

    mirror: (N, 2) intersection of the mirror direction with the disc's plane. spread: width of the lobe there.
    """

    def weights(places: NDArray[np.float32]) -> NDArray[np.float32]:
        square = ((places - mirror) ** 2).sum(axis=1)
        density = spread**2 / (square + spread**2) ** 2 / within
        return ((places**2).sum(axis=1) <= 1) / (DISC_POINTS + LOBE_POINTS * density)

    farthest = np.hypot(*mirror.T) + 1
    within = farthest**2 / (farthest**2 + spread**2)  # share of the lobe within reach of the disc's farthest point
    for places in disc(DISC_POINTS, TURNS).astype(np.float32).swapaxes(0, 1):
        yield places[turns], weights(places[turns])
    for places in disc(LOBE_POINTS, TURNS).swapaxes(0, 1):
        # Sample a GGX-like highlight: a share t of it is within the width times sqrt(t / (1 - t)).
        radius = np.hypot(*places.T)
        outwards, share = (places / radius[:, None]).astype(np.float32), (radius**2).astype(np.float32)
        share = np.minimum(share[turns], 1) * within
        about = mirror + (spread * np.sqrt(share / (1 - share)))[:, None] * outwards[turns]
        yield about, weights(about)
