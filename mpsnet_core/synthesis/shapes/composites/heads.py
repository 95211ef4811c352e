"""Heads: of bears, cats, rabbits, dogs, pigs and people, with ears, snouts, eyes, hair and hats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.synthesis.shapes.composites.assembly import FEATURES, HEAD, Piece
from mpsnet_core.synthesis.shapes.composites.things import hat
from mpsnet_core.synthesis.shapes.draws import between, chance, picked
from mpsnet_core.synthesis.shapes.shape import axes_along, placed, turn_about
from mpsnet_core.synthesis.shapes.solids import curved_limb, ellipsoid, limb

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Skull:
    """frame: rows right, up, ahead. size: along these, in radii. melt: width of its joints."""

    kind: str
    centre: Array
    frame: Array
    radius: float
    size: tuple[float, float, float]
    melt: float

    def at(self, x: float, y: float, z: float) -> Array:
        """The place that lies so many radii to the right, up and ahead."""
        return self.centre + self.radius * (np.array([x, y, z]) @ self.frame)


def head(
    rng: np.random.Generator, centre: ArrayLike, radius: float, facing: ArrayLike, soft: float, hatted: float = 0.4
) -> list[Piece]:
    """A head of one kind or another that looks along `facing`."""
    kind = picked(rng, ("bear", "cat", "rabbit", "dog", "pig", "person", "plain"), (4, 3, 2, 3, 1, 4, 1))
    wide, high, deep = between(rng, 0.82, 1.15), between(rng, 0.82, 1.15), between(rng, 0.85, 1.1)
    frame = axes_along(facing, (0, 0, 1))
    skull = _Skull(kind, np.asarray(centre, np.float64), frame, radius, (wide, high, deep), soft * 0.3 * radius)
    at = skull.at
    pieces: list[Piece] = [
        ellipsoid(skull.centre, radius * np.array([wide, high, deep]), frame, blend=skull.melt, part=HEAD),
        *_ears(rng, skull),
        *_face(rng, skull),
    ]
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
        top = skull.centre + radius * high * between(rng, 0.4, 0.7) * axes[2]
        pieces.append(placed(hat(rng), axes, radius * between(rng, 0.95, 1.15) * wide, top))
    return pieces


def _ears(rng: np.random.Generator, skull: _Skull) -> list[Piece]:
    kind, at, frame, radius = skull.kind, skull.at, skull.frame, skull.radius
    wide, high, _ = skull.size
    joint = max(0.04 * radius, skull.melt)
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


def _face(rng: np.random.Generator, skull: _Skull) -> list[Piece]:
    kind, at, frame, radius = skull.kind, skull.at, skull.frame, skull.radius
    _, _, deep = skull.size
    joint = max(0.05 * radius, 0.6 * skull.melt)
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
