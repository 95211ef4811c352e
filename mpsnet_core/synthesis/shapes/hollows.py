"""Hollows: shapes whose insides face the camera, where few lights reach and light bounces between the walls.

The largest errors on photographs are there: under arms and cloth, in laps, folds, ears, bowls and niches.
"""

from dataclasses import replace

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.noise import fractal_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, direction, integer, new_seed, rotation, uniform
from mpsnet_core.synthesis.shapes.blobs import CHARACTERS as BLOBS
from mpsnet_core.synthesis.shapes.blobs import build_blob
from mpsnet_core.synthesis.shapes.drapery import hammock
from mpsnet_core.synthesis.shapes.isosurface import Solid, box, ellipsoid, isosurface, limb
from mpsnet_core.synthesis.shapes.shape import Shape, displaced, fitted, joined, placed

CHARACTERS = ("vessel", "trough", "case", "niches", "figure", "hammock", "heap")


def build_hollow(character: str, rng: np.random.Generator, cells: int) -> Shape:
    """A hollow of this character, about 2 wide and open towards +z, roughly. cells: resolution of the grid."""
    if character == "hammock":
        return hammock(rng)
    if character == "heap":
        return _heap(rng, cells // 2)
    solids = {"vessel": _vessel, "trough": _trough, "case": _case, "niches": _niches, "figure": _figure}[character](rng)
    shape = isosurface(solids, 2.2 / cells)
    if chance(rng, 0.4):
        seed, scale, amount = new_seed(rng), uniform(rng, 3, 10), uniform(rng, 0.02, 0.08)
        shape = displaced(shape, lambda points: amount / scale * fractal_noise(points * scale, seed, 2))
    return shape


def _opening(rng: np.random.Generator) -> F64:
    """(3, 3) axes of a hollow: the last, in which it opens, is at most about 60 degrees from +z."""
    up = normalised(np.array([0.0, 0.0, 1.0]) + uniform(rng, 0, 1) * direction(rng))
    side = normalised(np.cross(up, direction(rng)))
    return np.stack([np.cross(side, up), side, up])


def _vessel(rng: np.random.Generator) -> list[Solid]:
    """A bowl, cup, shell or dented ball: a rounded body without a smaller copy of it and without its top."""
    axes, edge = _opening(rng), uniform(rng, 0.01, 0.08)
    radii = np.array([uniform(rng, 0.6, 1.0), uniform(rng, 0.6, 1.0), uniform(rng, 0.4, 1.2)])
    wall, top = uniform(rng, 0.06, 0.25), uniform(rng, -0.1, 0.7) * radii[2]
    half = np.array([3.0, 3.0, 1.5])
    inside = axes[2] * uniform(rng, 0, 0.15) + direction(rng) * wall * 0.3
    return [
        ellipsoid((0, 0, 0), radii, axes),
        ellipsoid(inside, np.maximum(radii - wall, 0.2), axes, blend=edge, carve=True),
        replace(box(axes[2] * (top + half[2]), half, 0.02, axes), blend=edge, carve=True),
    ]


def _trough(rng: np.random.Generator) -> list[Solid]:
    """A tube or gutter, straight or tapered, cut open lengthwise, with one or two closed ends."""
    axes, edge = _opening(rng), uniform(rng, 0.01, 0.08)
    long, near, far = uniform(rng, 0.4, 0.9), uniform(rng, 0.3, 0.6), uniform(rng, 0.3, 0.6)
    wall, ends = uniform(rng, 0.06, 0.2), uniform(rng, 0.0, 0.5) * np.array([chance(rng, 0.5), chance(rng, 0.5)])
    start, end = axes[0] * -long, axes[0] * long
    half, top = np.array([3.0, 3.0, 1.5]), uniform(rng, -0.1, 0.35)
    return [
        limb(start, end, near, far),
        limb(start * (1 + ends[0]), end * (1 + ends[1]), near - wall, far - wall, blend=edge, carve=True),
        replace(box(axes[2] * (top + half[2]), half, 0.02, axes), blend=edge, carve=True),
    ]


def _case(rng: np.random.Generator) -> list[Solid]:
    """An open box, with compartments, or with something in it."""
    axes, edge = _opening(rng), uniform(rng, 0.005, 0.06)
    half = np.array([uniform(rng, 0.5, 0.9), uniform(rng, 0.5, 0.9), uniform(rng, 0.25, 0.7)])
    wall = uniform(rng, 0.06, 0.2)
    solids = [box((0, 0, 0), half, uniform(rng, 0.02, 0.1), axes)]
    across = choice(rng, (1, 1, 2, 3))
    wide = (half[0] - wall) / across
    for place in range(across):
        middle = axes[0] * (wide * (2 * place + 1) - half[0] + wall) + axes[2] * uniform(rng, wall, half[2])
        room = np.array([max(wide - wall / 2, 0.08), half[1] - wall, half[2]])
        solids.append(replace(box(middle, room, 0.04, axes), blend=edge, carve=True))
    if chance(rng, 0.4):
        radii = half * [uniform(rng, 0.25, 0.6) for _ in range(3)]
        solids.append(ellipsoid(-axes[2] * half[2] * 0.4, radii, axes @ rotation(rng), blend=edge))
    return solids


def _niches(rng: np.random.Generator) -> list[Solid]:
    """A body with slots, folds and niches that cut deep into it."""
    half = np.array([uniform(rng, 0.6, 1.0), uniform(rng, 0.6, 1.0), uniform(rng, 0.4, 0.8)])
    block = chance(rng, 0.4)
    solids = [box((0, 0, 0), half, uniform(rng, 0.05, 0.3)) if block else ellipsoid((0, 0, 0), half, rotation(rng))]
    for _ in range(integer(rng, 3, 8)):
        edge = uniform(rng, 0.01, 0.12)
        axes = _opening(rng)
        aside = direction(rng) * [1, 1, 0] * uniform(rng, 0, 0.8) * half
        mouth = aside + np.array([0, 0, half[2] * uniform(rng, 0.3, 0.9)])
        wide, deep = uniform(rng, 0.06, 0.3), uniform(rng, 0.2, 0.7)
        if chance(rng, 0.5):  # a slot, straight or bent in depth
            radii = (wide, uniform(rng, 1.5, 5) * wide, deep)
            solids.append(ellipsoid(mouth, radii, axes, blend=edge, carve=True))
        else:
            solids.append(limb(mouth - axes[2] * deep, mouth + axes[2], wide, 1.5 * wide, blend=edge, carve=True))
    return solids


def _figure(rng: np.random.Generator) -> list[Solid]:
    """A body with limbs that press against it or reach forward, as arms, laps and necks do, with sharp gaps."""
    soft = choice(rng, (0.0, uniform(rng, 0.02, 0.15)))
    body = np.array([uniform(rng, 0.25, 0.5), uniform(rng, 0.5, 0.9), uniform(rng, 0.25, 0.45)])
    solids = [ellipsoid((0, 0, 0), body, blend=soft)]
    if chance(rng, 0.7):
        head = uniform(rng, 0.15, 0.3)
        solids.append(ellipsoid((uniform(rng, -0.1, 0.1), body[1] + head * 0.7, 0.1), head, blend=soft))
    for _ in range(integer(rng, 2, 6)):
        thick, side = uniform(rng, 0.08, 0.22), choice(rng, (-1, 1))
        start = np.array([side * (body[0] + thick * uniform(rng, -0.3, 0.6)), uniform(rng, -0.8, 0.6), 0.0])
        middle = start + uniform(rng, 0.3, 0.7) * normalised(direction(rng) * [0.6, 1, 0.6] + [0, 0, 0.5])
        end = middle + uniform(rng, 0.2, 0.6) * normalised(direction(rng) - [0.8 * side, 0, -0.2])
        solids.append(limb(start, middle, thick, thick * 0.9, blend=soft))
        solids.append(limb(middle, end, thick * 0.9, thick * uniform(rng, 0.6, 0.9), blend=soft))
    return solids


def _heap(rng: np.random.Generator, cells: int) -> Shape:
    """Four to six things that touch each other, seen from above."""
    pieces: list[Shape] = []
    for number in range(integer(rng, 4, 6)):
        thing = fitted(build_blob(choice(rng, BLOBS), rng, cells))
        angle, away = uniform(rng, 0, 2 * np.pi), uniform(rng, 0.35, 0.65) * (number > 0)
        offset = (away * np.cos(angle), away * np.sin(angle), uniform(rng, -0.25, 0.25))
        pieces.append(placed(thing, rotation(rng), uniform(rng, 0.3, 0.5), offset))
    return joined(pieces)
