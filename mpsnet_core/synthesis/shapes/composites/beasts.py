"""Beasts: animals on four legs, birds, and an octopus."""

# ruff: noqa: RUF005 (an array plus a tuple is a sum here)

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.composites.assembly import ARMS, BASE, BODY, FEATURES, HEAD, LEGS, Piece, softness
from mpsnet_core.synthesis.shapes.composites.heads import head
from mpsnet_core.synthesis.shapes.composites.things import canopy, thing
from mpsnet_core.synthesis.shapes.draws import between, chance, count, picked
from mpsnet_core.synthesis.shapes.shape import axes_along
from mpsnet_core.synthesis.shapes.solids import box, curved_limb, cylinder, ellipsoid, limb

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])


def quadruped(rng: np.random.Generator) -> list[Piece]:
    """An animal on four legs that stands, sits upright or lies, its head over its forelegs or turned."""
    soft = softness(rng)
    stance = picked(rng, ("stands", "sits", "lies"), (4, 4, 2))
    length, girth = between(rng, 0.7, 1.3), between(rng, 0.22, 0.42)
    legs = {"stands": between(rng, 0.35, 0.9), "sits": between(rng, 0.5, 0.9), "lies": 0.0}[stance]
    thick = between(rng, 0.08, 0.17)
    rise = between(rng, 35, 65) if stance == "sits" else between(rng, -8, 14)
    along = np.array([0, -np.cos(np.radians(rise)), np.sin(np.radians(rise))])
    hips = np.array([0, 0, girth * 0.95 + (legs if stance == "stands" else 0)])
    chest = hips + length * along
    chest[2] = max(chest[2], girth * 0.9)
    sag = (hips + chest) / 2 + (0, 0, between(rng, -0.15, 0.1))
    r = girth * np.array([between(rng, 0.8, 1.25), between(rng, 0.85, 1.2), between(rng, 0.75, 1.0)])
    pieces: list[Piece] = [*curved_limb((hips, sag, chest), r, part=BODY, pieces=4)]
    if stance == "lies":
        ends = [(side * 0.8 * girth, chest[1] - between(rng, 0.2, 0.5)) for side in (-1, 1)]
        for side, (x, y) in zip((-1, 1), ends, strict=True):
            elbow = np.array([side * girth, chest[1] + 0.15, thick])
            pieces.append(
                limb(chest + (side * 0.5 * girth, 0, -0.1), elbow, 1.4 * thick, thick, blend=soft * thick, part=LEGS)
            )
            pieces.append(limb(elbow, (x, y, thick), thick, 0.9 * thick, blend=0.4 * thick, part=LEGS))
    else:
        for side in (-1, 1):
            shoulder = chest + (side * 0.65 * r[2], 0.05, -0.05)
            foot = np.array(
                [side * between(rng, 0.4, 0.9) * girth, shoulder[1] - between(rng, -0.1, 0.25), 0.5 * thick]
            )
            pieces.append(limb(shoulder, foot, 1.5 * thick, 0.85 * thick, blend=soft * thick, part=LEGS))
            pieces.append(limb(foot, foot + (0, -0.9 * thick, 0), thick, 0.8 * thick, blend=0.3 * thick, part=LEGS))
    for side in (-1, 1):
        joint = hips + (side * 0.7 * r[0], 0, 0)
        if stance == "stands":
            knee = joint + (side * 0.05, between(rng, -0.12, 0.05), -0.45 * legs)
            foot = np.array([joint[0], joint[1] + between(rng, -0.05, 0.25), 0.5 * thick])
            pieces.append(limb(joint, knee, 1.8 * thick, 1.1 * thick, blend=soft * thick, part=LEGS))
            pieces.append(limb(knee, foot, 1.1 * thick, 0.85 * thick, blend=0.4 * thick, part=LEGS))
        else:
            haunch = joint + (side * 0.1, -0.1, -0.1)
            pieces.append(ellipsoid(haunch, (0.5 * girth, 0.9 * girth, 0.7 * girth), blend=soft * thick, part=LEGS))
            foot = np.array([haunch[0] + side * 0.1, haunch[1] - 0.8 * girth, thick])
        pieces.append(limb(foot, foot + (0, -1.2 * thick, 0), thick, 0.85 * thick, blend=0.3 * thick, part=LEGS))
    radius = between(rng, 0.22, 0.42)
    turn = between(rng, -75, 75) if chance(rng, 0.5) else between(rng, -15, 15)
    facing = np.array([np.sin(np.radians(turn)), -np.cos(np.radians(turn)), between(rng, -0.5, 0.2)])
    reach = between(rng, 0.15, 0.7)
    nape = chest + (0, -between(rng, 0.1, 0.5) * reach, reach) + 0.4 * radius * normalised(facing)
    nape[2] = max(nape[2], radius)
    neck = between(rng, 0.45, 0.75)
    pieces.append(limb(chest, nape, neck * r[2], neck * radius, blend=(0.2 + 0.3 * soft) * girth, part=BODY))
    pieces += head(rng, nape, radius, facing, soft, hatted=0.08)
    if chance(rng, 0.85):
        end = hips + (between(rng, -0.6, 0.6), r[0] + between(rng, 0, 0.6), between(rng, -hips[2] + 0.1, 0.7))
        bow = hips + (between(rng, -0.4, 0.4), r[0] + between(rng, 0.2, 0.6), between(rng, -0.2, 0.5))
        tail = between(rng, 0.04, 0.1)
        pieces += curved_limb(
            (hips + (0, 0.7 * r[0], 0), bow, end), (tail, tail, tail * between(rng, 0.6, 2)), blend=0.05, part=FEATURES
        )
    if stance == "stands" and chance(rng, 0.35):
        saddle = (hips + chest) / 2 + (0, 0, girth)
        for side in (-1, 1):
            pieces += thing(rng, saddle + (side * 1.1 * girth, 0, -0.6 * girth), between(rng, 0.2, 0.32))
    if chance(rng, 0.2):
        pieces.append(box((0, -0.4 * length, -0.07), (girth * 2, length * 1.1, 0.09), 0.02, blend=0.02, part=BASE))
    if chance(rng, 0.12):
        pieces += canopy(rng, between(rng, 0.8, 1.2), nape[2] + radius * between(rng, 1.5, 2.2))
    return pieces


def bird(rng: np.random.Generator) -> list[Piece]:
    """A bird: an egg of a body, a head with a beak over the breast, folded or spread wings."""
    soft = softness(rng)
    size = between(rng, 0.4, 0.6)
    pitch = between(rng, 10, 60)
    along = np.array([0, -np.cos(np.radians(pitch)), np.sin(np.radians(pitch))])
    body = np.array([0, 0, size + between(rng, 0, 0.4)])
    axes = axes_along(along, UP)
    slim = between(rng, 0.65, 0.95)
    pieces: list[Piece] = [
        ellipsoid(body, (slim * size, slim * size, 1.25 * size), axes, part=BODY),
        limb(body + 0.6 * size * along, body + 1.2 * size * along, 0.6 * size, 0.4 * size, blend=0.3 * size, part=BODY),
    ]
    radius = between(rng, 0.22, 0.36)
    top = body + size * (1.25 * along + (0, 0, between(rng, 0.2, 0.7))) + (0, -0.1, 0)
    pieces.append(limb(body + size * along, top, 0.35 * size, 0.7 * radius, blend=0.2 * size, part=BODY))
    turn = between(rng, -60, 60)
    facing = np.array([np.sin(np.radians(turn)), -np.cos(np.radians(turn)), between(rng, -0.4, 0.1)])
    facing /= np.linalg.norm(facing)
    pieces.append(ellipsoid(top, radius, blend=0.05 + 0.1 * soft, part=HEAD))
    beak = between(rng, 0.5, 1.4)
    pieces.append(
        limb(
            top + 0.7 * radius * facing,
            top + (0.9 + beak) * radius * facing,
            between(rng, 0.25, 0.5) * radius,
            0.06 * radius,
            blend=0.03,
            part=FEATURES,
        )
    )
    across = np.cross(facing, UP)
    for side in (-1, 1):
        eye = top + radius * normalised(0.6 * facing + 0.35 * UP + side * 0.75 * across)
        pieces.append(ellipsoid(eye, 0.17 * radius, blend=0.02, part=FEATURES))
    if chance(rng, 0.4):
        pieces += curved_limb(
            (top, top + radius * (1.3 * UP), top + radius * (1.3 * UP - 0.9 * facing)),
            (0.3 * radius, 0.15 * radius, 0.06 * radius),
            blend=0.04,
            part=FEATURES,
        )
    spread = chance(rng, 0.35)
    for side in (-1, 1):
        if spread:
            root, tip = (
                body + (side * 0.6 * size, -0.1, 0.3 * size),
                body + (side * between(rng, 1.4, 2.0) * size, 0.2, between(rng, -0.2, 1.3) * size),
            )
            wing_axes = axes_along(tip - root, along)
            pieces.append(
                ellipsoid(
                    (root + tip) / 2,
                    (0.1, 0.45 * size, 0.62 * float(np.linalg.norm(tip - root))),
                    wing_axes,
                    blend=0.03,
                    part=ARMS,
                )
            )
        else:
            wing_axes = axes_along(along + (0, 0, -0.2), (side, 0, 0))
            pieces.append(
                ellipsoid(
                    body + (side * 0.85 * slim * size, 0.1, 0),
                    (0.5 * size, 0.18 * size, 1.05 * size),
                    wing_axes,
                    blend=0.02 + 0.04 * soft,
                    part=ARMS,
                )
            )
    tail = body - 1.0 * size * along
    tail_axes = axes_along(-along + (0, 0, between(rng, 0, 0.6)), UP)
    pieces.append(
        ellipsoid(
            tail - 0.4 * size * along, (0.4 * size, 0.1 * size, 0.7 * size), tail_axes, blend=0.1 * size, part=FEATURES
        )
    )
    for side in (-1, 1):
        foot = np.array([side * 0.4 * size, body[1] - 0.1, 0.0])
        pieces.append(limb(body + (side * 0.35 * size, 0, -0.4 * size), foot, 0.1, 0.06, blend=0.05, part=LEGS))
        pieces.append(limb(foot + (0, 0.05, 0), foot + (side * 0.05, -0.28, 0), 0.06, 0.05, blend=0.03, part=LEGS))
    if chance(rng, 0.4):
        pieces.append(cylinder((0, 0, -0.12), 0.75 * size + 0.2, 0.1, 0.03, blend=0.03, part=BASE))
    return pieces


def octopus(rng: np.random.Generator) -> list[Piece]:
    """A big head on many curling arms."""
    soft = softness(rng)
    radius = between(rng, 0.4, 0.6)
    top = np.array([0, 0, between(rng, 0.5, 0.9)])
    pieces: list[Piece] = [ellipsoid(top + (0, 0.1, 0.2), radius * np.array([1, 1, between(rng, 0.9, 1.5)]), part=HEAD)]
    arms = count(rng, 5, 9)
    thick = between(rng, 0.1, 0.18)
    for k in range(arms):
        angle = 2 * np.pi * (k + between(rng, -0.2, 0.2)) / arms
        out = np.array([np.cos(angle), np.sin(angle), 0])
        bow = out * between(rng, 0.5, 1.0) + (0, 0, between(rng, 0.1, 0.9))
        end = out * between(rng, 0.7, 1.5) + np.cross(UP, out) * between(rng, -0.6, 0.6) + (0, 0, between(rng, 0, 0.6))
        pieces += curved_limb(
            (top + 0.5 * radius * out - (0, 0, 0.3), bow, end),
            (thick * 1.5, thick, 0.3 * thick),
            blend=soft * 0.15,
            part=ARMS,
            pieces=6,
        )
    for side in (-1, 1):
        eye = top + radius * np.array([side * 0.45, -0.85, 0.25])
        pieces.append(ellipsoid(eye, 0.2 * radius, blend=0.03, part=FEATURES))
    return pieces
