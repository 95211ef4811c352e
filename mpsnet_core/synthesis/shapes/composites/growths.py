"""Growths: branching bodies, mushrooms and tangles, for shadows of forms that have no name."""

# ruff: noqa: RUF005 (an array plus a tuple is a sum here)

import numpy as np

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.composites.assembly import ARMS, BASE, BODY, DRESS, FEATURES, HEAD, Piece, softness
from mpsnet_core.synthesis.shapes.draws import between, chance, count, direction, picked, turned
from mpsnet_core.synthesis.shapes.shape import axes_along, placed
from mpsnet_core.synthesis.shapes.solids import box, curved_limb, ellipsoid, limb, ring
from mpsnet_core.synthesis.shapes.surfaces import smooth_curve, smooth_profile, tube, turned_profile


def growth(rng: np.random.Generator) -> list[Piece]:
    """A body from which limbs grow at random, and from those more: balls, boxes, rings or points at their ends."""
    soft = softness(rng)
    core = between(rng, 0.35, 0.6)
    pieces: list[Piece] = [
        ellipsoid((0, 0, 0), core * np.array([between(rng, 0.7, 1.3) for _ in range(3)]), turned(rng))
    ]
    tips = [(np.zeros(3), core, 0)]
    while len(pieces) < 34 and tips:
        start, thick, depth = tips.pop(0)
        for _ in range(count(rng, 4, 7) if depth == 0 else count(rng, 0, 2)):
            way = direction(rng)
            if depth:
                way = normalised(way + start / np.linalg.norm(start))
            length = between(rng, 0.25, 0.6)
            end = start + way * (length + 0.7 * thick)
            bow = (start + end) / 2 + direction(rng) * 0.3 * length
            slim = min(thick, between(rng, 0.09, 0.24))
            pieces += curved_limb(
                (start, bow, end), (slim, slim, slim * between(rng, 0.4, 1.1)), blend=soft * slim, part=ARMS, pieces=3
            )
            knob = between(rng, 0.12, 0.34)
            kind = picked(rng, ("ball", "egg", "box", "ring", "none"))
            if kind in ("ball", "egg"):
                radii = knob * (np.ones(3) if kind == "ball" else np.array([between(rng, 0.5, 1.2) for _ in range(3)]))
                pieces.append(ellipsoid(end, radii, turned(rng), blend=soft * 0.1, part=HEAD))
            elif kind == "box":
                pieces.append(box(end, knob * 0.8, 0.15 * knob, turned(rng), blend=0.03, part=FEATURES))
            elif kind == "ring":
                pieces.append(ring(end + way * knob, knob, 0.3 * knob, turned(rng), blend=0.04, part=DRESS))
            if depth < 2:
                tips.append((end, slim, depth + 1))
    return pieces


def mushrooms(rng: np.random.Generator) -> list[Piece]:
    """Mushrooms whose caps stand over each other, on a lump of ground."""
    pieces: list[Piece] = [ellipsoid((0, 0, -0.1), (0.9, 0.8, 0.25), part=BASE)]
    for _ in range(count(rng, 2, 6)):
        foot = np.array([between(rng, -0.5, 0.5), between(rng, -0.5, 0.5), 0])
        top = foot + (between(rng, -0.3, 0.3), between(rng, -0.3, 0.3), between(rng, 0.4, 1.4))
        thick = between(rng, 0.07, 0.15)
        pieces += curved_limb(
            (foot, (foot + top) / 2 + direction(rng) * 0.1, top),
            (1.4 * thick, thick, thick),
            blend=0.1,
            part=BODY,
            pieces=3,
        )
        wide, high = between(rng, 0.3, 0.65), between(rng, 0.5, 1.1)
        profile = [
            (0.05, 0.05),
            (0.5, -0.02),
            (0.93, -0.12),
            (1.0, -0.08),
            (0.85, 0.25 * high),
            (0.45, 0.5 * high),
            (0.02, 0.58 * high),
        ]
        cap = turned_profile(smooth_profile(profile), HEAD)
        pieces.append(placed(cap, axes_along(normalised(top - foot) + direction(rng) * 0.2), wide, top))
    return pieces


def tangle(rng: np.random.Generator) -> list[Piece]:
    """Thick ropes or roots wound around each other, alone or about a ball."""
    pieces: list[Piece] = []
    core = between(rng, 0.35, 0.6)
    if chance(rng, 0.6):
        pieces.append(limb((0, 0, 0), (0, 0, 0), core, core, part=BODY))
    for strand in range(count(rng, 2, 5)):
        way = direction(rng)
        knots = []
        for _ in range(count(rng, 5, 9)):
            way = normalised(way + 0.9 * direction(rng))
            knots.append(way * (core + between(rng, 0.08, 0.5)))
        curve = smooth_curve(np.array(knots), 10)
        thick = between(rng, 0.09, 0.17)
        pieces.append(tube(curve, thick * np.linspace(1, between(rng, 0.4, 1), len(curve)), ARMS + strand % 3, 24))
    return pieces
