"""Procedural textures of a surface: material weights, paint, dirt and bump, as functions of object space."""

from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, I32, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.noise import Points, fractal_noise, gradient_noise, voronoi
from mpsnet_core.synthesis.scene_description import Bump, Dirt, Paint, Pattern
from mpsnet_core.synthesis.shading.directions import frames

# The noise is nearly normally distributed, with this standard deviation.
NOISE = NormalDist(0, 0.306)
_LEVELS = np.linspace(-1, 1, 129)
_SHARES = np.array([NOISE.cdf(level) for level in _LEVELS])

PAINT_OCTAVES, DIRT_OCTAVES = 1, 2
DARKEST_PAINT = 0.05
DIRT_EDGE = 0.15  # half the width of dirt's soft edges, in units of its noise
BUMP_STEP = 0.01  # step of the finite differences, as a share of a bump's length


def material_weights(pattern: Pattern, count: int, points: Points, parts: I32) -> F32:
    """(N, count) weights of the materials at points (N, 3) in object space on parts (N,); rows sum to 1."""
    weights = np.zeros((len(points), count), np.float32)
    if count == 1:
        weights[:] = 1
        return weights
    every = np.arange(len(points))
    own, neighbour, border = _zones(pattern, count, points, parts)
    if not pattern.softness:
        weights[every, own] = 1
        return weights
    # The neighbour's weight is 1/2 at the border, and 0 at half the softness from it.
    share = np.maximum(0.5 - border / pattern.softness, 0).astype(np.float32)
    weights[every, own] = 1 - share
    weights[every, neighbour] += share
    return weights


def _zones(
    pattern: Pattern, count: int, points: Points, parts: I32
) -> tuple[NDArray[np.integer[Any]], NDArray[np.integer[Any]], Floats]:
    """(N,) material of each point, material beyond the nearest border, and distance to the border in zone widths."""
    if pattern.kind == "parts":
        own = parts % count
        return own, own, np.ones(len(points))
    places = points * pattern.scale
    if pattern.warp:
        bend = [gradient_noise(places / 2, pattern.seed + 1 + axis) for axis in range(3)]
        places = places + 2 * pattern.warp * np.stack(bend, axis=1)
    if pattern.kind == "voronoi":
        cell, across, border = voronoi(places, pattern.seed)
        return cell % count, across % count, border
    if pattern.kind == "noise":  # the cumulative distribution gives bands of equal area
        level = np.interp(gradient_noise(places, pattern.seed), _LEVELS, count * _SHARES)
    else:
        level = places @ np.asarray(pattern.direction, points.dtype)
    whole = np.floor(level).astype(np.int64)
    fraction = level - whole
    beside = whole + np.where(fraction < 0.5, -1, 1)
    if pattern.kind == "noise":
        whole, beside = np.clip(whole, 0, count - 1), np.clip(beside, 0, count - 1)
    return whole % count, beside % count, np.minimum(fraction, 1 - fraction)


def paint_factors(paint: Paint, points: Points) -> F32 | None:
    """(N, 3) factors above 0 of the materials' colours at points (N, 3) in object space; None without paint."""
    if not paint.amount:
        return None
    places = points * paint.scale
    channels = 3 if paint.hue else 1
    own = np.stack([fractal_noise(places, paint.seed + channel, PAINT_OCTAVES) for channel in range(channels)], axis=1)
    common = own[:, :1]
    factors = 1 + np.float32(paint.amount) * (common + np.float32(paint.hue) * (own - common))
    return np.broadcast_to(np.maximum(factors, np.float32(DARKEST_PAINT)), (len(points), 3))


def dirt_weight(dirt: Dirt, points: Points) -> F32 | None:
    """(N,) opacity of dirt at points (N, 3) in object space; None without dirt."""
    if not dirt.amount:
        return None
    level = fractal_noise(points * dirt.scale, dirt.seed, DIRT_OCTAVES)
    edge = NOISE.inv_cdf(1 - min(dirt.amount, 0.999))
    share = np.clip((level - np.float32(edge - DIRT_EDGE)) / np.float32(2 * DIRT_EDGE), 0, 1)
    return share * share * (3 - 2 * share)


def bumped(bump: Bump, points: Points, normals: F32) -> F32:
    """Unit `normals` (N, 3), perturbed by the bump at points (N, 3), both in object space.

    The normal of a surface displaced by a height h is n - grad h, with the gradient along the surface (Blinn 1978).
    """
    if not bump.height:
        return normals
    step = BUMP_STEP / bump.scale
    places = points * bump.scale
    level = gradient_noise(places, bump.seed)
    raised = normals.copy()
    for tangent in frames(normals):
        rise = gradient_noise(places + BUMP_STEP * tangent, bump.seed) - level
        raised -= (rise * np.float32(bump.height / step))[:, None] * tangent
    return normalised(raised)
