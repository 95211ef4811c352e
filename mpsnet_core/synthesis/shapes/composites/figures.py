"""Figures: people and upright animals, heads over bodies, with bent arms that hold things; busts."""

# ruff: noqa: RUF005 (an array plus a tuple is a sum here)

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.composites.assembly import ARMS, BASE, BODY, DRESS, LEGS, LOAD, Piece, softness
from mpsnet_core.synthesis.shapes.composites.heads import head
from mpsnet_core.synthesis.shapes.composites.things import canopy, thing
from mpsnet_core.synthesis.shapes.draws import between, chance, picked
from mpsnet_core.synthesis.shapes.shape import axes_along
from mpsnet_core.synthesis.shapes.solids import Solid, box, cylinder, ellipsoid, limb, ring
from mpsnet_core.synthesis.shapes.surfaces import smooth_profile, tube, turned_profile

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Trunk:
    """Where the chest, the waist and the head are; half the shoulders' and the belly's width, the belly's depth."""

    chest: Array
    waist: Array
    crown: Array
    shoulders: float
    wide: float
    deep: float


def biped(rng: np.random.Generator) -> list[Piece]:
    """A figure that stands, sits or wears a robe, its head over its body, its arms at something or nothing."""
    soft = softness(rng)
    tall, wide = between(rng, 0.75, 1.3), between(rng, 0.26, 0.48)
    deep = wide * between(rng, 0.7, 1.05)
    radius = between(rng, 0.24, 0.48)
    stance = picked(rng, ("stands", "sits", "robe", "squats"), (4, 4, 3, 1))
    hip = {"stands": between(rng, 0.3, 0.75), "sits": deep * 0.75, "robe": 0.35, "squats": 0.3}[stance]
    lean = between(rng, -0.15, 0.25)  # forward is -y
    chest = np.array([0, -lean * tall * 0.5, hip + 0.62 * tall])
    top = np.array([0, -lean * tall * 0.8, hip + 0.9 * tall])
    belly = between(rng, 0.85, 1.25)
    waist = np.array([0.0, 0.0, hip + 0.2 * tall])
    pieces: list[Piece] = [
        ellipsoid(waist, (wide * belly, deep * belly, 0.36 * tall), blend=0.0, part=BODY),
        limb(waist, chest, 0.8 * wide, between(rng, 0.5, 0.8) * wide, blend=(0.3 + 0.3 * soft) * wide, part=BODY),
    ]
    shoulder_wide = between(rng, 0.75, 1.1) * wide
    thick = between(rng, 0.085, 0.16)
    pieces += _legs(rng, stance, hip, wide, deep, soft)
    # The head leans forward over the body, so that its shadow falls on the chest and the arms.
    ahead = between(rng, 0.0, 0.6) * radius
    facing = normalised(np.array([between(rng, -0.5, 0.5), -1, between(rng, -0.35, 0.25)]))
    crown = top + (0, -ahead, radius * between(rng, 0.5, 0.85))
    pieces.append(limb(chest, crown, 0.42 * radius, 0.5 * radius, blend=soft * 0.2, part=BODY))
    pieces += head(rng, crown, radius, facing, soft)
    pieces += _arms(rng, _Trunk(chest, waist, crown, shoulder_wide, wide * belly, deep * belly), thick, soft)
    if chance(rng, 0.3):
        collar = (chest + 2 * crown) / 3
        axes = axes_along(crown - chest)
        size = between(rng, 0.5, 0.75) * radius
        pieces.append(ring(collar, size, 0.3 * size, axes, height=between(rng, 0.8, 1.6), blend=0.03, part=DRESS))
    if chance(rng, 0.22):
        half = (0.7 * wide, 0.4 * deep, 0.35 * tall)
        middle = chest + (0, deep + 0.1, -0.1)
        pieces.append(box(middle, half, 0.06, blend=0.02, part=LOAD))
    if chance(rng, 0.25):
        size = between(rng, 1.1, 1.7) * max(wide * belly, deep)
        pieces.append(cylinder((0, 0, -0.06), size, 0.08, 0.02, blend=0.02, part=BASE))
    if chance(rng, 0.12):
        pieces += canopy(rng, between(rng, 0.7, 1.1), crown[2] + radius * between(rng, 1.3, 2.0))
    return pieces


def _legs(rng: np.random.Generator, stance: str, hip: float, wide: float, deep: float, soft: float) -> list[Piece]:
    thick = between(rng, 0.11, 0.2)
    pieces: list[Piece] = []
    if stance == "robe":
        flare = between(rng, 1.1, 1.9)
        profile = [
            (0.01, 0.0),
            (wide * flare * 0.5, 0.0),
            (wide * flare * 0.97, 0.0),
            (wide * flare, 0.03),
            (wide * (1 + flare) / 2.1, 0.3),
            (wide, 0.6),
            (0.4 * wide, 0.9),
        ]
        pieces.append(turned_profile(smooth_profile(profile), DRESS))
        return pieces
    for side in (-1, 1):
        joint = np.array([side * 0.5 * wide, 0.0, hip])
        if stance == "stands":
            foot = np.array([side * (0.5 * wide + between(rng, -0.05, 0.2)), between(rng, -0.25, 0.1), 0.06])
            knee = (joint + foot) / 2 + (0, -between(rng, 0, 0.12), 0)
        else:
            up = between(rng, 0.05, 0.5) if stance == "sits" else 0.55
            spread = between(rng, 0.1, 0.5)
            ahead = -deep - (between(rng, 0.25, 0.6) if stance == "sits" else 0.15)
            foot = np.array([side * (0.5 * wide + spread), ahead - 0.1, 0.1])
            knee = np.array([side * (0.5 * wide + spread * 0.8), (ahead + 0.1) * 0.6, 0.12 + up])
        pieces.append(limb(joint, knee, 1.35 * thick, thick, blend=soft * thick, part=LEGS))
        pieces.append(limb(knee, foot, thick, 0.85 * thick, blend=0.4 * thick, part=LEGS))
        toe = foot + (side * 0.03, -1.1 * thick, 0.0) if stance != "sits" else foot + (0, -0.3 * thick, 1.1 * thick)
        pieces.append(limb(foot, toe, 1.0 * thick, 0.95 * thick, blend=0.3 * thick, part=LEGS))
    return pieces


def _arms(rng: np.random.Generator, trunk: _Trunk, thick: float, soft: float) -> list[Piece]:
    chest, waist, crown = trunk.chest, trunk.waist, trunk.crown
    pieces: list[Piece] = []
    pose = picked(rng, ("hold", "free", "belly", "reach"), (6, 3, 2, 1.5))
    length = between(rng, 0.75, 1.05)
    front = np.array([0, -trunk.deep, 0])
    if pose == "hold":
        size = between(rng, 0.16, 0.36)
        place = chest + 1.05 * front + (between(rng, -0.1, 0.1), -0.6 * size, between(rng, -0.35, 0.0))
        pieces += [*thing(rng, place, size)]
    for side in (-1, 1):
        shoulder = chest + (side * trunk.shoulders, 0, between(rng, 0.02, 0.12))
        out = np.array([side * 1.0, between(rng, 0.0, 0.8), -between(rng, 0.1, 1.0)])
        if pose == "hold":
            hand = place + (side * size * 0.85, -between(rng, 0.2, 0.6) * size, between(rng, -0.6, 0.2) * size)
        elif pose == "belly":
            hand = waist + 1.0 * front + (side * between(rng, 0.05, 0.2), 0, between(rng, 0.05, 0.35))
        elif pose == "reach":
            hand = chest + front * 1.4 + (side * between(rng, 0.1, 0.5), -0.25, between(rng, -0.2, 0.6))
        else:
            hand = {
                "hang": shoulder + (side * between(rng, 0.05, 0.3), -0.15, -0.8),
                "akimbo": waist + (side * trunk.wide * 0.95, -0.05, 0.12),
                "raised": shoulder + (side * between(rng, 0.1, 0.5), -0.2, between(rng, 0.5, 0.9)),
                "chin": crown + (side * 0.1, -0.3, -0.35),
                "out": shoulder + (side * 0.8, -0.2, between(rng, -0.3, 0.4)),
            }[picked(rng, ("hang", "akimbo", "raised", "chin", "out"))]
        limbs = arm(shoulder, hand, length, thick, out, soft)
        pieces += limbs
        if chance(rng, 0.12):
            end = limbs[-1].centre
            stick = [end + (0, 0, -0.7), end + (0, -0.02, 0), end + (0, 0, between(rng, 0.4, 1.0))]
            pieces.append(tube(np.array(stick), between(rng, 0.03, 0.06), LOAD))
        elif chance(rng, 0.12):
            pieces += thing(rng, limbs[-1].centre + (side * 0.05, -0.1, -0.25), between(rng, 0.14, 0.24))
    return pieces


def arm(shoulder: Array, hand: Array, length: float, thick: float, outward: Array, soft: float) -> list[Solid]:
    """A bent arm: shoulder to elbow to hand, the elbow out towards `outward` as far as `length` leaves it."""
    reach = hand - shoulder
    span = float(np.linalg.norm(reach))
    if span > 0.98 * length:
        hand = shoulder + reach * (0.98 * length / span)
        reach = hand - shoulder
        span = 0.98 * length
    along = reach / span
    out = outward - (outward @ along) * along
    out /= max(float(np.linalg.norm(out)), 1e-6)
    elbow = shoulder + reach / 2 + out * np.sqrt((length / 2) ** 2 - (span / 2) ** 2)
    melt = soft * thick
    return [
        limb(shoulder, elbow, 1.1 * thick, 0.9 * thick, blend=melt, part=ARMS),
        limb(elbow, hand, 0.9 * thick, 0.75 * thick, blend=0.4 * thick, part=ARMS),
        ellipsoid(hand + 0.3 * thick * along, 1.15 * thick, blend=0.3 * thick, part=ARMS),
    ]


def bust(rng: np.random.Generator) -> list[Piece]:
    """A head with a neck on shoulders, cut off and set on a foot."""
    soft = softness(rng)
    radius = between(rng, 0.5, 0.62)
    shoulders = between(rng, 0.45, 0.85)
    top = np.array([0, -between(rng, 0, 0.15), 1.35])
    pieces: list[Piece] = [
        ellipsoid((0, 0.05, 0.35), (shoulders, 0.36, 0.36), part=BODY),
        limb((0, 0.05, 0.4), top, 0.26, 0.28, blend=0.25, part=BODY),
        box((0, 0, -0.5), (1.5, 1.5, 0.45), 0.02, blend=0.02, part=BASE, carve=True),
    ]
    turn = between(rng, -40, 40)
    facing = np.array([np.sin(np.radians(turn)), -np.cos(np.radians(turn)), between(rng, -0.35, 0.15)])
    pieces += head(rng, top, radius, facing, soft, hatted=0.35)
    if chance(rng, 0.5):
        pieces.append(ring((0, 0.03, between(rng, 0.62, 0.8)), 0.34, 0.1, height=1.3, blend=0.03, part=DRESS))
    profile = [
        (0.01, -0.55),
        (0.42, -0.55),
        (0.44, -0.5),
        (0.3, -0.38),
        (0.18, -0.25),
        (0.16, -0.12),
        (0.3, -0.02),
        (0.25, 0.1),
    ]
    pieces.append(turned_profile(smooth_profile(profile), BASE))
    return pieces
