"""Vessels: vases, jugs, teapots, cups with handles, spouts and lids; sacks."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.composites.assembly import BASE, BODY, FEATURES, Piece
from mpsnet_core.synthesis.shapes.composites.things import ball, crate, fruit, sack
from mpsnet_core.synthesis.shapes.draws import between, chance, count, picked
from mpsnet_core.synthesis.shapes.shape import Shape, placed, turn_about
from mpsnet_core.synthesis.shapes.surfaces import displaced, smooth_curve, smooth_profile, tube, turned_profile

Array = NDArray[np.float64]
UP = (0.0, 0.0, 1.0)


def vessel(rng: np.random.Generator) -> list[Piece]:
    """A vase, jug, teapot, cup or amphora."""
    high = between(rng, 0.8, 2.0)
    radii = [
        between(rng, 0.3, 0.6),
        between(rng, 0.45, 0.85),
        between(rng, 0.55, 0.95),
        between(rng, 0.25, 0.85),
        between(rng, 0.3, 0.75),
    ]
    heights = np.array([0.0, 0.22, 0.5, 0.8, 1.0]) * high
    outer = smooth_curve(list(zip(radii, heights, strict=True)), 12)
    wall = between(rng, 0.06, 0.1)
    along = normalised(np.gradient(np.column_stack([outer, np.zeros(len(outer))]), axis=0))
    inner = outer - wall * np.column_stack([along[:, 1], -along[:, 0]])
    inner = inner[(inner[:, 1] > 0.12) & (inner[:, 1] < high) & (inner[:, 0] > 0.05)][::-1]
    lip = (outer[-1] + inner[0]) / 2 + (0, 0.6 * wall)
    foot, floor = [(0.02, 0.02), (radii[0] * 0.8, 0.0)], [(0.5 * inner[-1, 0], 0.11), (0.02, 0.1)]
    body = turned_profile([*foot, *outer, lip, *inner, *floor], BODY, 128)
    ribs, depth = count(rng, 5, 26), between(rng, 0.12, 0.35) * wall
    if chance(rng, 0.3):
        winding = between(rng, -3, 3)
        body = displaced(
            body,
            lambda p: (
                depth
                * np.clip((p[:, 0] ** 2 + p[:, 1] ** 2) * 8 - 0.3, 0, 1)
                * np.cos(ribs * np.arctan2(p[:, 1], p[:, 0]) + winding * p[:, 2] * 4)
            ),
        )
    pieces: list[Piece] = [body]

    def wall_at(height: float) -> float:
        return float(np.interp(height * high, outer[:, 1], outer[:, 0])) - wall / 2

    handles = picked(rng, (0, 1, 2, 3), (1, 4, 4, 1))
    low, top, out = between(rng, 0.15, 0.5), between(rng, 0.7, 0.97), between(rng, 0.3, 0.7)
    thick = between(rng, 0.04, 0.09)
    for k in range(handles):
        angle = 2 * np.pi * k / handles
        around = np.array([np.cos(angle), np.sin(angle), 0])
        reach = max(wall_at(low), wall_at(top)) + out
        knots = [
            wall_at(low) * around + (0, 0, low * high),
            reach * 0.9 * around + (0, 0, (low + between(rng, 0.0, 0.15)) * high),
            reach * around + (0, 0, (low + top) / 2 * high),
            reach * 0.85 * around + (0, 0, (top + between(rng, 0.0, 0.2)) * high),
            wall_at(top) * around + (0, 0, top * high),
        ]
        curve = smooth_curve(knots, 8)
        pieces.append(tube(curve, thick * (1 + 0.4 * np.cos(np.linspace(0, 2 * np.pi, len(curve)))), FEATURES))
    if handles < 2 and chance(rng, 0.5):
        end = between(rng, 0.75, 1.15)
        spout = [
            (-0.9 * wall_at(0.35), 0, 0.35 * high),
            (-wall_at(0.35) - 0.3, 0, 0.4 * high),
            (-wall_at(0.6) - 0.5, 0, 0.75 * high),
            (-wall_at(0.6) - 0.75, 0, end * high),
        ]
        curve = smooth_curve(spout, 8)
        pieces.append(tube(curve, np.linspace(0.22, 0.09, len(curve)), FEATURES, 28))
    if chance(rng, 0.45):
        brim = radii[4]
        profile = [
            (0.02, -0.02),
            (brim * 1.02, 0.0),
            (brim * 1.06, 0.05),
            (brim * 0.8, 0.16),
            (brim * 0.3, between(rng, 0.2, 0.4)),
            (0.1, 0.42),
            (0.16, 0.52),
            (0.02, 0.62),
        ]
        tilt = turn_about((1, 0.3, 0), between(rng, -6, 6))
        pieces.append(placed(turned_profile(smooth_profile(profile), FEATURES), tilt, 1.0, (0, 0, high)))
    elif chance(rng, 0.4):
        for _ in range(count(rng, 3, 6)):
            angle, away = between(rng, 0, 2 * np.pi), between(rng, 0, 0.6) * radii[4]
            size = between(rng, 0.16, 0.32)
            pieces.append(
                placed(fruit(rng, size), None, 1.0, (away * np.cos(angle), away * np.sin(angle), high + 0.4 * size))
            )
    if chance(rng, 0.3):
        bosses, level = count(rng, 5, 12), between(rng, 0.3, 0.75)
        for k in range(bosses):
            angle = 2 * np.pi * k / bosses
            spot = (
                (wall_at(level) + wall / 2) * np.cos(angle),
                (wall_at(level) + wall / 2) * np.sin(angle),
                level * high,
            )
            pieces.append(ball(between(rng, 0.08, 0.11), spot, FEATURES))
    if chance(rng, 0.4):
        pieces.append(crate((radii[0] * 1.5, radii[0] * 1.5, 0.1), 0.03, None, (0, 0, -0.09), BASE))
    return pieces


def full_sack(rng: np.random.Generator) -> list[Piece]:
    """A tied sack among smaller ones, boxes and fruit."""
    main = placed(sack(rng, 0.8), turn_about(UP, between(rng, 0, 360)), 1.0, (0, 0, 0.8))
    pieces: list[Piece] = [main]
    for _ in range(count(rng, 2, 6)):
        angle, size = between(rng, 0, 2 * np.pi), between(rng, 0.2, 0.5)
        away = 0.75 + size * between(rng, 0.6, 1.0)
        place = np.array([away * np.cos(angle), away * np.sin(angle), 0.9 * size])
        axes = turn_about(UP, between(rng, 0, 360)) @ turn_about((1, 0, 0), between(rng, -25, 25))
        shape: Shape = picked(
            rng, (sack(rng, size), fruit(rng, size), crate((size, 0.7 * size, 0.8 * size), 0.1 * size))
        )
        pieces.append(placed(shape, axes, 1.0, place))
    if chance(rng, 0.5):
        pieces.append(crate((1.5, 1.5, 0.1), 0.03, None, (0, 0, -0.1), BASE))
    return pieces
