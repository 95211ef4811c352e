"""Constructions: robots, vehicles, dwellings and piles, of boxes, cylinders and roofs that hang over."""

# ruff: noqa: RUF005 (an array plus a tuple is a sum here)

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.synthesis.shapes.composites.assembly import ARMS, BASE, BODY, DRESS, FEATURES, HEAD, LEGS, LOAD, Piece
from mpsnet_core.synthesis.shapes.composites.things import ball, crate, fruit, sack
from mpsnet_core.synthesis.shapes.draws import between, chance, count, picked
from mpsnet_core.synthesis.shapes.shape import Shape, axes_along, placed, turn_about
from mpsnet_core.synthesis.shapes.surfaces import bent, slab, smooth_curve, tube, turned_profile

Array = NDArray[np.float64]
UP = (0.0, 0.0, 1.0)


def drum(radius: float, height: float, bevel: float, part: int, top: float = 1.0) -> Shape:
    """A cylinder from z = 0 to `height`, `top` times as wide above as below, its rims rounded."""
    turns = np.linspace(0, np.pi / 2, 5)
    low = [(radius - bevel * (1 - np.sin(t)), bevel * (1 - np.cos(t))) for t in turns]
    high = [(radius * top - bevel * (1 - np.sin(t)), height - bevel * (1 - np.cos(t))) for t in turns[::-1]]
    ends = [(max(0.01, radius - 3 * bevel), 0.0), *low, *high, (max(0.01, radius * top - 3 * bevel), height)]
    return turned_profile(ends, part, 64)


def rod(start: ArrayLike, end: ArrayLike, radius: float, part: int, top: float = 1.0) -> Shape:
    """A cylinder between two points."""
    along = np.subtract(end, start).astype(np.float64)
    length = float(np.linalg.norm(along))
    return placed(drum(radius, length, 0.2 * radius, part, top), axes_along(along), 1.0, start)


def robot(rng: np.random.Generator) -> list[Piece]:
    """A toy robot of boxes, cylinders and balls."""
    wide, deep, tall = between(rng, 0.35, 0.6), between(rng, 0.25, 0.45), between(rng, 0.35, 0.6)
    legs = between(rng, 0.3, 0.8)
    middle = np.array([0, 0, legs + tall])
    bevel = between(rng, 0.03, 0.12)
    pieces: list[Piece] = [crate((wide, deep, tall), bevel, None, middle, BODY)]
    if chance(rng, 0.3):
        pieces = [placed(drum(wide, 2 * tall, bevel, BODY, between(rng, 0.6, 1.2)), None, 1.0, (0, 0, legs))]
    size = between(rng, 0.22, 0.42)
    nod = turn_about(UP, between(rng, -40, 40)) @ turn_about((1, 0, 0), between(rng, -10, 25))
    top = middle + (0, -between(rng, 0, 0.25), tall + size * between(rng, 0.9, 1.3))
    if chance(rng, 0.6):
        pieces.append(crate((size * between(rng, 1, 1.4), size, size * 0.85), bevel, nod, top, HEAD))
    else:
        pieces.append(ball(size * 1.1, top, HEAD))
    pieces.append(rod(middle, top, 0.3 * size, FEATURES))
    for side in (-1, 1):
        eye = top + np.array([side * 0.45 * size, -size * 1.0, 0.15 * size]) @ nod
        pieces.append(placed(drum(0.2 * size, 0.25 * size, 0.03 * size, FEATURES), axes_along(-nod[1]), 1.0, eye))
        pieces.append(
            rod(top, top + np.array([side * size * 0.6, 0, size * between(rng, 1.2, 1.9)]) @ nod, 0.08 * size, FEATURES)
        )
        shoulder = middle + (side * (wide + 0.08), 0, tall * 0.65)
        elbow = shoulder + (side * between(rng, 0.05, 0.3), -between(rng, -0.1, 0.2), -between(rng, 0.2, 0.45))
        hand = elbow + (-side * between(rng, -0.2, 0.4), -between(rng, 0.15, 0.5), between(rng, -0.35, 0.35))
        thick = between(rng, 0.07, 0.14)
        pieces += [
            ball(1.4 * thick, shoulder, FEATURES),
            rod(shoulder, elbow, thick, ARMS),
            ball(1.2 * thick, elbow, FEATURES),
        ]
        pieces += [
            rod(elbow, hand, 0.9 * thick, ARMS),
            crate((1.5 * thick, 1.8 * thick, 1.1 * thick), 0.03, None, hand, FEATURES),
        ]
        hip, foot = (
            np.array([side * 0.5 * wide, 0, legs + 0.1]),
            np.array([side * between(rng, 0.45, 0.7) * wide, between(rng, -0.15, 0.1), 0.1]),
        )
        pieces += [
            rod(hip, foot, between(rng, 0.09, 0.16), LEGS),
            crate((0.17, 0.26, 0.1), 0.04, None, foot + (0, -0.1, 0), LEGS),
        ]
    if chance(rng, 0.6):
        pieces.append(crate((wide * 0.6, 0.06, tall * 0.4), 0.03, None, middle + (0, -deep, 0.1), DRESS))
    if chance(rng, 0.4):
        axes = turn_about(UP, between(rng, -30, 30))
        pieces.append(crate((0.3, 0.25, 0.22), 0.04, axes, middle + (0, -deep - 0.35, -0.15), LOAD))
    return pieces


def vehicle(rng: np.random.Generator) -> list[Piece]:
    """A cart, lorry or car with something on it."""
    long, wide, radius = between(rng, 0.9, 1.2), between(rng, 0.4, 0.55), between(rng, 0.2, 0.36)
    floor = radius + between(rng, 0.1, 0.25)
    pieces: list[Piece] = [crate((wide, long, 0.16), 0.06, None, (0, 0, floor), BODY)]
    cabin = between(rng, 0.3, 0.45)
    pieces.append(crate((wide * 0.9, 0.36, cabin), 0.1, None, (0, -long * 0.5, floor + cabin), HEAD))
    pieces.append(crate((wide * 1.05, 0.46, 0.05), 0.04, None, (0, -long * 0.5, floor + 2 * cabin + 0.03), DRESS))
    for side in (-1, 1):
        for y in (-0.65, 0.65):
            axes = axes_along((side, 0, 0))
            tyre = drum(radius, 0.16, 0.05, LEGS)
            pieces.append(placed(tyre, axes, 1.0, (side * (wide - 0.03), y * long, radius)))
            pieces.append(
                placed(drum(0.45 * radius, 0.2, 0.03, FEATURES), axes, 1.0, (side * (wide - 0.03), y * long, radius))
            )
    for _ in range(count(rng, 1, 4)):
        size = between(rng, 0.2, 0.34)
        place = (between(rng, -0.2, 0.2), between(rng, 0.05, 0.75) * long, floor + 0.15 + size)
        load = picked(rng, (crate((size, size, size), 0.05), sack(rng, size), fruit(rng, size), ball(size)))
        pieces.append(placed(load, turn_about(UP, between(rng, 0, 90)), 1.0, place))
    return pieces


def dwelling(rng: np.random.Generator) -> list[Piece]:
    """A house, tower or castle with roofs that hang over and stairs or arches."""
    pieces: list[Piece] = [crate((1.2, 1.1, 0.08), 0.03, None, (0, 0, -0.07), BASE)]
    for k in range(count(rng, 1, 4)):
        away = 0.55 if k else 0.0
        spot = np.array([between(rng, -away, away), between(rng, -away, away), 0])
        axes = turn_about(UP, 90 * count(rng, 0, 3) + between(rng, -15, 15))
        tall = between(rng, 0.35, 1.0)
        if chance(rng, 0.55):
            x, y, eaves = between(rng, 0.25, 0.5), between(rng, 0.3, 0.6), between(rng, 1.1, 1.5)
            pieces.append(crate((x, y, tall / 2), 0.02, axes, spot + (0, 0, tall / 2), BODY))
            pitch = between(rng, 0.25, 0.6)
            gable = _rounded([(-x * eaves, 0), (x * eaves, 0), (0, pitch)], 0.06)
            roof = placed(
                slab(gable - gable.mean(axis=0), 2 * y * eaves, 0.03, DRESS), offset=(0, gable[:, 1].mean(), -y * eaves)
            )
            # The slab's outline lies in x and y: its y becomes up.
            pieces.append(placed(placed(roof, [(1, 0, 0), (0, 0, 1), (0, -1, 0)]), axes, 1.0, spot + (0, 0, tall)))
            pieces.append(
                crate(
                    (0.07, 0.07, 0.25), 0.02, axes, spot + np.array([0.5 * x, 0, tall + pitch * 0.7]) @ axes, FEATURES
                )
            )
            pieces.append(crate((0.1, 0.08, 0.17), 0.02, axes, spot + np.array([0, -y, 0.17]) @ axes, FEATURES))
        else:
            r = between(rng, 0.18, 0.36)
            pieces.append(placed(drum(r, 1.4 * tall, 0.02, BODY, between(rng, 0.8, 1.1)), None, 1.0, spot))
            over = between(rng, 1.25, 1.7)
            pieces.append(
                placed(drum(r * over, between(rng, 0.3, 0.7), 0.02, DRESS, 0.12), None, 1.0, spot + (0, 0, 1.4 * tall))
            )
    for _ in range(count(rng, 0, 3)):
        angle = between(rng, 0, 2 * np.pi)
        spot = np.array([np.cos(angle), np.sin(angle), 0]) * between(rng, 0.8, 1.0)
        pieces += [
            rod(spot, spot + (0, 0, 0.35), 0.05, LEGS),
            ball(between(rng, 0.18, 0.3), spot + (0, 0, 0.5), FEATURES),
        ]
    return pieces


def pile(rng: np.random.Generator) -> list[Piece]:
    """Boxes, balls, cushions and rings laid on one another, each askew over the one below."""
    pieces: list[Piece] = []
    height, size = 0.0, between(rng, 0.6, 0.9)
    offset = np.zeros(3)
    for _ in range(count(rng, 3, 7)):
        thick = size * between(rng, 0.2, 0.65)
        axes = turn_about(UP, between(rng, 0, 360)) @ turn_about((1, 0, 0), between(rng, -6, 6))
        place = offset + (0, 0, height + thick)
        kind = picked(rng, ("box", "drum", "stone", "ring"))
        if kind == "box":
            piece = crate((size, size * between(rng, 0.5, 1), thick), between(rng, 0.05, 0.9) * thick)
        elif kind == "drum":
            piece = placed(
                drum(size, 2 * thick, between(rng, 0.05, 0.3) * thick, BODY, between(rng, 0.75, 1.2)),
                offset=(0, 0, -thick),
            )
        elif kind == "stone":
            radii = (size, size * between(rng, 0.6, 1), 1.1 * thick)
            piece = bent(ball(1.0), partial(np.multiply, radii))
        else:
            angles = np.linspace(0, 2 * np.pi, 73)
            circle = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles]) * (size - 0.8 * thick)
            piece = tube(circle, min(thick, 0.45 * size), BODY, 28)
        pieces.append(placed(replace(piece, parts=np.full_like(piece.parts, len(pieces))), axes, 1.0, place))
        height += 1.85 * thick
        size *= between(rng, 0.65, 1.08)
        offset = offset + (between(rng, -0.2, 0.2) * size, between(rng, -0.2, 0.2) * size, 0)
    if chance(rng, 0.5):
        knots = [
            (0.0, 0, height),
            (between(rng, -0.3, 0.3), 0.2, height + 0.3),
            (between(rng, -0.7, 0.7), -0.4, height + 0.25),
        ]
        pieces.append(tube(smooth_curve(knots, 8), 0.07, FEATURES))
    return pieces


def _rounded(corners: list[tuple[float, float]], radius: float) -> Array:
    """A convex outline, counter-clockwise, its corners cut by short curves."""
    points = np.array(corners)
    pieces = []
    for before, here, after in zip(np.roll(points, 1, axis=0), points, np.roll(points, -1, axis=0), strict=True):
        a = here + radius * (before - here) / np.linalg.norm(before - here)
        b = here + radius * (after - here) / np.linalg.norm(after - here)
        t = np.linspace(0, 1, 5)[:, None]
        pieces.append((1 - t) ** 2 * a + 2 * t * (1 - t) * here + t**2 * b)
    return np.concatenate(pieces)
