"""Ambient occlusion: how much of the sky each pixel's surface sees, told by its heights."""

from math import gcd, hypot

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.errors import InputError
from mpsnet_core.heights.height_map import HeightMap
from mpsnet_core.heights.parallel import mean_depth, parallel_heights
from mpsnet_core.heights.sizes import check_size
from mpsnet_core.normals import NormalMap
from mpsnet_core.progress import Progress, silent

# Horizons are looked for along lines from pixel to pixel, each up to so many to the side and up at a step.
FINENESS = 2
# At least so many to each doubling of the distance: what is far counts by its angle.
STRETCHES = 4


def ambient_occlusion(
    heights: HeightMap, normals: NormalMap, *, reach: int | None = None, progress: Progress = silent
) -> NDArray[np.float32]:
    """(H, W) 0 to 1: the share of a cosine-weighted hemisphere over each pixel's normal that the surface leaves open.

    1 on what is convex or flat and outside the mask. What lies behind the visible surface does not count.

    By horizons: in each of 16 directions over the picture the highest angle under which the surface is seen, and
    between the horizons of two opposite ones the integral in closed form (Jimenez et al., Practical Real-Time
    Strategies for Accurate Indirect Occlusion, SIGGRAPH 2016 courses, section 4). Of what is
    far away only the highest pixel of each stretch counts.

    reach: how far it looks, in pixels; as far as the object goes unless given.

    Raises InputError where the sizes do not agree or the reach is below 1.
    """
    mask, camera = heights.mask, heights.camera
    check_size("height map", mask.shape, normals)
    check_reach(reach)
    lines = _lines(FINENESS)
    raised, farthest = np.where(mask, parallel_heights(heights), -np.inf), _extent(mask)
    spacing = mean_depth(heights) / camera.focal
    seen, open_sky = np.zeros((2, *mask.shape), np.float32)
    for number, (line, weight) in enumerate(lines):
        horizons: list[NDArray[np.float32]] = []
        for end in (line, -line):
            progress((number + len(horizons) / 2) / len(lines), "ambient occlusion")
            horizons.append(_horizon(raised, spacing, end, min(reach or farthest, farthest)))
        for rows in bands(len(mask)):
            slopes = [horizon[rows] for horizon in horizons]
            share, whole = _slice(heights, normals.vectors[rows], line / camera.focal, slopes, rows)
            seen[rows] += weight * share
            open_sky[rows] += weight * whole
    return np.where(mask, np.clip(seen / np.maximum(open_sky, 1e-6), 0, 1), np.float32(1))


def check_reach(reach: int | None) -> None:
    """Raises InputError where ambient occlusion cannot look so few pixels far."""
    if reach is not None and reach < 1:
        raise InputError(f"ambient occlusion over {reach} pixels is none; give 1 or more")


def _extent(mask: NDArray[np.bool_]) -> int:
    """How far apart two pixels of the mask can be."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return int(hypot(rows[-1] - rows[0], columns[-1] - columns[0])) + 1


def _lines(fineness: int) -> list[tuple[NDArray[np.int64], float]]:
    """Half of all directions, as whole steps (to the right, up), and what share of all angles each stands for."""
    span = range(-fineness, fineness + 1)
    steps = sorted(
        ((x, y) for x in span for y in span if gcd(x, y) == 1 and (y > 0 or (y == 0 and x > 0))),
        key=lambda step: np.arctan2(step[1], step[0]),
    )
    angles = np.array([np.arctan2(y, x) for x, y in steps])
    around = np.concatenate([[angles[-1] - np.pi], angles, [np.pi]])
    shares = (around[2:] - around[:-2]) / (2 * np.pi)
    return [(np.array(step), float(share)) for step, share in zip(steps, shares, strict=True)]


def _horizon(
    raised: NDArray[np.float32], spacing: NDArray[np.float64], line: NDArray[np.int64], reach: int
) -> NDArray[np.float32]:
    """(H, W) the highest slope along a line, up to `reach` pixels away; minus infinity where there is nothing.

    What is farther away is looked at in longer stretches of the line, at the highest pixel of each: all are points of
    the surface, so that nothing is hidden by what is not there.
    """
    sides = raised.shape[::-1]
    most = min(
        int(reach / hypot(*line)), *((side - 1) // step for side, step in zip(sides, abs(line), strict=True) if step)
    )
    slopes = np.full(raised.shape, -np.inf, np.float32)
    base = np.where(np.isfinite(raised), raised, np.float32(0))
    # Of the stretch that begins at each pixel: how high its highest pixel is, and how many steps on.
    highest, place = raised, np.zeros(raised.shape, np.float32)
    stretch, times = 1, 1
    while times <= most:
        if times >= 2 * STRETCHES * stretch:
            own, ahead = _overlap(raised.shape, stretch * line)
            higher = highest[ahead] > highest[own]
            highest, place = highest.copy(), place.copy()
            np.copyto(place[own], place[ahead] + np.float32(stretch), where=higher)
            np.copyto(highest[own], highest[ahead], where=higher)
            stretch *= 2
        own, ahead = _overlap(raised.shape, times * line)
        rise = highest[ahead] - base[own]
        rise /= place[ahead] + np.float32(times)
        np.maximum(slopes[own], rise, out=slopes[own])
        times += stretch
    slopes /= np.float32(hypot(*(line * spacing)))
    return slopes


def _overlap(shape: tuple[int, ...], step: NDArray[np.int64]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of all pixels that have another one a step (to the right, up) away, and of those others."""
    (height, width), (right, up) = shape, step.tolist()
    own = slice(max(0, up), height + min(0, up)), slice(max(0, -right), width - max(0, right))
    ahead = slice(max(0, -up), height - max(0, up)), slice(max(0, right), width + min(0, right))
    return own, ahead


def _slice(
    heights: HeightMap,
    vectors: NDArray[np.float32],
    line: NDArray[np.float64],
    slopes: list[NDArray[np.float32]],
    rows: slice,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Of the plane through the view and a line over the picture: how much light comes in, and how much if all is open.

    slopes: along the line and back; :func:`parallel_heights` says what they mean.
    """
    camera = heights.camera
    east, north = (line / np.hypot(*line)).astype(np.float32)
    if camera.projection == "orthographic":
        view = np.array([0, 0, 1], np.float32)
        lean, aside, scale = np.float32(0), np.float32(1), np.float32(1)
        beside = np.array([east, north, 0], np.float32)
    else:
        depth = np.where(heights.mask[rows], -heights.values[rows], np.float32(1))
        towards = -camera.points(np.ones_like(depth), rows.start).astype(np.float32)
        length = np.linalg.norm(towards, axis=-1)
        view = towards / length[..., None]
        lean = east * view[..., 0] + north * view[..., 1]
        beside = np.array([east, north, 0], np.float32) - lean[..., None] * view
        aside = np.linalg.norm(beside, axis=-1)
        beside /= aside[..., None]
        scale = depth / np.float32(mean_depth(heights)) * length
    upright, tilted = (vectors * view).sum(axis=-1), (vectors * beside).sum(axis=-1)
    size, angle = np.hypot(upright, tilted), np.arctan2(tilted, upright)
    half = np.float32(np.pi / 2)
    ahead = np.minimum(np.arctan2(aside, lean + scale * slopes[0]), angle + half)
    behind = np.maximum(-np.arctan2(aside, -lean + scale * slopes[1]), angle - half)
    sine, cosine = np.sin(angle), np.cos(angle)
    share = 0.5 * cosine + 0.5 * (ahead + behind) * sine
    share -= 0.25 * (np.cos(2 * ahead - angle) + np.cos(2 * behind - angle))
    return size * share, size * (cosine + angle * sine)
