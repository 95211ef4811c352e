"""Creatures: heads over bodies, bent arms that hold things, legs, ears, tails, hats."""

# ruff: noqa: RUF005 (an array plus a tuple is a sum here)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.normals import normalised
from mpsnet_core.synthesis.shapes.composites.assembly import ARMS, BASE, BODY, DRESS, FEATURES, HEAD, LEGS, LOAD, Piece
from mpsnet_core.synthesis.shapes.composites.things import canopy, hat, thing
from mpsnet_core.synthesis.shapes.draws import between, chance, count, picked
from mpsnet_core.synthesis.shapes.shape import Shape, axes_along, placed, turn_about
from mpsnet_core.synthesis.shapes.solids import Solid, box, curved_limb, cylinder, ellipsoid, limb, ring
from mpsnet_core.synthesis.shapes.surfaces import smooth_profile, tube, turned_profile

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])


def softness(rng: np.random.Generator) -> float:
    """How wide joints flow into each other, as a share of the limbs' thickness: pressed clay to melted wax."""
    return picked(rng, (0.12, 0.35, 0.8, 1.4), (2, 3, 3, 1))


def head(
    rng: np.random.Generator, centre: ArrayLike, radius: float, facing: ArrayLike, soft: float, hatted: float = 0.4
) -> list[Piece]:
    """A head of one kind or another that looks along `facing`."""
    middle = np.asarray(centre, np.float64)
    frame = axes_along(facing, UP)  # right, up, ahead
    melt = soft * 0.3 * radius

    def at(x: float, y: float, z: float) -> Array:
        return middle + radius * (np.array([x, y, z]) @ frame)

    kind = picked(rng, ("bear", "cat", "rabbit", "dog", "pig", "person", "plain"), (4, 3, 2, 3, 1, 4, 1))
    skull = np.array([between(rng, 0.82, 1.15), between(rng, 0.82, 1.15), between(rng, 0.85, 1.1)])
    pieces: list[Piece] = [ellipsoid(middle, radius * skull, frame, blend=melt, part=HEAD)]
    wide, high, deep = skull
    pieces += _ears(rng, kind, at, frame, radius, skull, melt)
    pieces += _face(rng, kind, at, frame, radius, skull, melt)
    if kind == "person" and chance(rng, 0.7):
        hair = between(rng, 1.02, 1.18)
        size = radius * hair * np.array([wide, high * 0.95, deep * 0.95])
        pieces.append(ellipsoid(at(0, 0.12, -0.22), size, frame, blend=0.05 * radius, part=FEATURES))
        if chance(rng, 0.5):
            pieces.append(
                ellipsoid(at(0, between(rng, -0.6, 1.0), -0.9), radius * 0.4, blend=0.05 * radius, part=FEATURES)
            )
        if chance(rng, 0.4):
            size = radius * np.array([0.45, between(rng, 0.5, 0.9), 0.35])
            pieces.append(ellipsoid(at(0, -0.85, 0.7), size, frame, blend=0.08 * radius, part=FEATURES))
    if chance(rng, hatted):
        tilt = turn_about(frame[2], between(rng, -15, 15)) @ turn_about(frame[0], between(rng, -12, 18))
        axes = np.stack([frame[0], -frame[2], frame[1]]) @ tilt
        top = middle + radius * high * between(rng, 0.4, 0.7) * axes[2]
        pieces.append(placed(hat(rng), axes, radius * between(rng, 0.95, 1.15) * wide, top))
    return pieces


def _ears(rng, kind, at, frame, radius, skull, melt) -> list[Piece]:  # type: ignore[no-untyped-def]
    wide, high, _ = skull
    joint = max(0.04 * radius, melt)
    size, lean, back = between(rng, 0.75, 1.3), between(rng, -0.1, 0.35), between(rng, -0.25, 0.15)
    pieces: list[Piece] = []
    for side in (-1, 1):
        if kind in ("bear", "pig"):
            centre = at(side * 0.72 * wide, 0.72 * high, back)
            radii = radius * size * np.array([0.34, 0.34, 0.15])
            pieces.append(ellipsoid(centre, radii, frame, blend=joint, part=HEAD))
            pieces.append(
                ellipsoid(
                    centre + 0.14 * radius * size * frame[2],
                    0.2 * radius * size,
                    blend=0.05 * radius,
                    part=HEAD,
                    carve=True,
                )
            )
        elif kind == "cat":
            tip = at(side * (0.7 + lean) * wide, (0.9 + 0.45 * size) * high, back)
            pieces.append(
                limb(
                    at(side * 0.55 * wide, 0.55 * high, back), tip, 0.33 * radius, 0.05 * radius, blend=joint, part=HEAD
                )
            )
        elif kind == "rabbit":
            droop = between(rng, -0.6, 1.2)
            path = (
                at(side * 0.4 * wide, 0.7 * high, back),
                at(side * (0.5 + lean), 1.7 * size, back),
                at(side * (0.7 + 2 * lean), 0.6 + 1.3 * size * droop, back + 0.2),
            )
            pieces += curved_limb(path, np.array([0.16, 0.3, 0.1]) * radius, blend=joint, part=HEAD, pieces=4)
        elif kind == "dog":
            axes = turn_about(frame[2], side * between(rng, 5, 40)).T
            radii = radius * size * np.array([0.14, 0.55, 0.32])
            pieces.append(
                ellipsoid(at(side * 0.98 * wide, 0.05, back), radii, frame @ axes, blend=joint, part=FEATURES)
            )
        elif kind == "person":
            radii = radius * np.array([0.1, 0.24, 0.16])
            pieces.append(ellipsoid(at(side * 0.98 * wide, -0.02, -0.05), radii, frame, blend=joint, part=HEAD))
    return pieces


def _face(rng, kind, at, frame, radius, skull, melt) -> list[Piece]:  # type: ignore[no-untyped-def]
    _, _, deep = skull
    joint = max(0.05 * radius, 0.6 * melt)
    pieces: list[Piece] = []
    length = {"bear": 0.35, "cat": 0.2, "rabbit": 0.15, "dog": 0.7, "pig": 0.3, "person": 0.0, "plain": 0.0}[kind]
    length *= between(rng, 0.7, 1.5)
    low = between(rng, -0.4, -0.15)
    if length:
        thick = between(rng, 0.32, 0.46)
        tip = at(0, low - 0.05, 0.62 * deep + length)
        blunt = thick * (1.0 if kind == "pig" else between(rng, 0.6, 0.9))
        pieces.append(limb(at(0, low, 0.55 * deep), tip, thick * radius, blunt * radius, blend=joint, part=HEAD))
        nose = tip + blunt * radius * (0.85 * frame[2] + 0.35 * frame[1])
        radii = radius * blunt * np.array([0.45, 0.32, 0.3])
        pieces.append(ellipsoid(nose, radii, frame, blend=0.03 * radius, part=FEATURES))
        slit = tip + blunt * radius * (0.75 * frame[2] - 0.6 * frame[1])
        span = 0.7 * blunt * radius * frame[0]
        pieces.append(
            limb(slit - span, slit + span, 0.05 * radius, 0.05 * radius, blend=0.05 * radius, part=HEAD, carve=True)
        )
    elif kind == "person":
        bridge, tip = at(0, 0.15, 0.92 * deep), at(0, -0.15, 1.0 * deep + between(rng, 0.06, 0.3))
        pieces.append(
            limb(bridge, tip, 0.08 * radius, between(rng, 0.11, 0.2) * radius, blend=0.12 * radius, part=HEAD)
        )
        chin = at(0, -0.72, 0.55 * deep)
        pieces.append(ellipsoid(chin, radius * between(rng, 0.2, 0.38), blend=0.25 * radius, part=HEAD))
        for height in (-0.4, -0.52):
            a, b = at(-0.22, height, 0.86 * deep), at(0.22, height, 0.86 * deep)
            pieces.append(limb(a, b, 0.075 * radius, 0.075 * radius, blend=0.06 * radius, part=FEATURES))
        a, b = at(-0.42, 0.27, 0.83 * deep), at(0.42, 0.27, 0.83 * deep)
        pieces.append(limb(a, b, 0.11 * radius, 0.11 * radius, blend=0.15 * radius, part=HEAD))
    eyes = picked(rng, ("bumps", "sockets", "both", "none"))
    apart, height = between(rng, 0.3, 0.45), between(rng, 0.02, 0.25)
    for side in (-1, 1):
        place = at(side * apart, height, 0.87 * deep)
        if eyes in ("sockets", "both"):
            size = between(rng, 0.14, 0.22) * radius
            pieces.append(ellipsoid(place + 0.08 * radius * frame[2], size, blend=0.08 * radius, part=HEAD, carve=True))
        if eyes in ("bumps", "both"):
            pieces.append(
                ellipsoid(place - 0.02 * radius * frame[2], 0.13 * radius, blend=0.02 * radius, part=FEATURES)
            )
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
    pieces += _arms(rng, chest, shoulder_wide, deep * belly, wide * belly, thick, soft, crown, waist)
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


def _arms(rng, chest, shoulder_wide, deep, wide, thick, soft, crown, waist) -> list[Piece]:  # type: ignore[no-untyped-def]
    pieces: list[Piece] = []
    pose = picked(rng, ("hold", "free", "belly", "reach"), (6, 3, 2, 1.5))
    length = between(rng, 0.75, 1.05)
    front = np.array([0, -deep, 0])
    if pose == "hold":
        size = between(rng, 0.16, 0.36)
        place = chest + 1.05 * front + (between(rng, -0.1, 0.1), -0.6 * size, between(rng, -0.35, 0.0))
        pieces += [*thing(rng, place, size)]
    for side in (-1, 1):
        shoulder = chest + (side * shoulder_wide, 0, between(rng, 0.02, 0.12))
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
                "akimbo": waist + (side * wide * 0.95, -0.05, 0.12),
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


def pair(rng: np.random.Generator) -> list[Piece]:
    """Two or three figures close together, often with loads between them, on one ground."""
    makers = {"biped": biped, "quadruped": quadruped, "bird": bird}
    pieces: list[Piece] = []
    gap = between(rng, 0.35, 0.7)
    spots = [np.array([-gap, 0, 0]), np.array([gap, between(rng, -0.2, 0.2), 0])]
    if chance(rng, 0.3):
        spots.append(np.array([between(rng, -0.2, 0.2), between(rng, 0.5, 0.9), between(rng, 0.0, 0.2)]))
    for spot in spots:
        maker = makers[picked(rng, tuple(makers), (5, 2, 1))]
        turn = turn_about(UP, between(rng, -25, 60) * np.sign(spot[0]))
        scale = between(rng, 0.7, 1.0) * (0.8 if maker is biped else 0.7)
        pieces += [_moved(piece, turn, scale, spot) for piece in maker(rng)]
    for _ in range(picked(rng, (0, 1, 2, 4), (2, 5, 3, 2))):
        size = between(rng, 0.2, 0.45)
        pieces += thing(
            rng, np.array([between(rng, -0.25, 0.25), between(rng, -0.7, 0.0), between(rng, 0.9, 1.6) * size]), size
        )
    if chance(rng, 0.7):
        pieces.append(box((0, 0, -0.08), (between(rng, 1.0, 1.3), between(rng, 0.7, 1.0), 0.1), 0.03, part=BASE))
    return pieces


def _moved(piece: Piece, axes: Array, scale: float, offset: Array) -> Piece:
    if isinstance(piece, Shape):
        return placed(piece, axes, scale, offset)
    form = piece.distance
    return Solid(
        lambda points: form(points / scale) * scale,
        piece.centre @ axes * scale + offset,
        piece.axes @ axes,
        piece.half * scale,
        piece.blend * scale,
        piece.part,
        piece.carve,
    )
