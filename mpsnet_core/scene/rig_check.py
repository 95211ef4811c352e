"""Whether a rig fits its photo, or its lights would fit better in another order or orientation.

Equation 2 gives normals for three lights in any order and orientation, but those of a wrong one belong to no surface
(:mod:`mpsnet_core.arrays.orientation`).
"""

import logging
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays import orientation
from mpsnet_core.arrays.types import F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.errors import Note
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Lights up to this share of their channel's 95th percentile are shadow.
SHADOW = 0.05
# Rigs are alike if no light is farther than this from its counterpart, in degrees: such errors cost little.
ALIKE = 20.0
# A rig is wrong if it and those like it have a probability below WRONG, another one, those like it and the same turned
# by 180° have one above SURE, and one of that one's lights is at least MIN_DIFFERENCE degrees from its counterpart.
WRONG, SURE, MIN_DIFFERENCE = 0.005, 0.5, 25.0
# Most iterations that find the lights' strengths, the step of their logarithms that ends them sooner, and the weight of
# the prior that they are equally strong.
ROUNDS, SETTLED, STRENGTH_PRIOR = 15, 1e-9, 0.05
HALF_TURN_OF_LIGHTS = np.array([-1, -1, 1])
# What is wrong with a rig whose lights fit when turned by each of :data:`TURNS`.
TURN_WORDS = (
    "",
    "the lights are mirrored left to right (x points left)",
    "the lights are mirrored top to bottom (y points down)",
    "the lights are turned by 180°",
    "the lights are turned by 90° clockwise",
    "the lights are turned by 90° counter-clockwise",
    "the lights' x and y are exchanged",
    "the lights' x and y are exchanged and reversed",
)
# The number of mistakes that each needs: exchanged axes are turned and mirrored.
TURN_CHANGES = (0, 1, 1, 1, 1, 1, 2, 2)


@dataclass(frozen=True, eq=False)
class RigFit:
    """How well a rig fits a photo."""

    probability: float = 0.5
    """Probability of the rig and those like it, among all orders and orientations of its lights; 0.5 if the photo is
    not enough to tell."""
    better: str = ""
    """What is wrong with the rig, as in "the red and green lights are swapped"; empty unless that is sure."""
    directions: F64 | None = None
    """(3, 3). The light directions that fit better, one light per row; None unless that is sure."""


class _Candidate(NamedTuple):
    """Lights in another order and turned."""

    order: tuple[int, ...]
    """Numbers of the rig's lights."""
    turn: int
    """Index into :data:`TURNS`."""
    lights: F64
    """(3, 3) directions, one light per row."""
    measures: F64
    """(4,) measures of the Lambertian normals by these lights."""

    @property
    def changes(self) -> int:
        """The number of things that are wrong with the rig, if this candidate is right."""
        return (self.order != (0, 1, 2)) + TURN_CHANGES[self.turn]

    @property
    def words(self) -> str:
        """What is wrong with the rig, if this candidate is right."""
        return " and ".join(words for words in (_order_words(self.order), TURN_WORDS[self.turn]) if words)


def check_rig(pixels: Floats, mask: Bools, rig: LightRig) -> RigFit:
    """Whether a rig fits a photo.

    Parameters
    ----------
    pixels : (H, W, 3) array
        The photo, linear.
    mask : (H, W) bool array
        The object.
    rig : LightRig
        Its lights. Near lights count as distant ones in their directions at the target.

    Returns
    -------
    RigFit
        What is wrong with the rig is stated only if it is certain. Flat objects, and those that fill the photo, often
        leave it open.
    """
    blocks = orientation.blocks_of(pixels, mask)
    if blocks is None:
        return RigFit()
    light = np.maximum(rig.unmixed(blocks.values), 0).astype(np.float64)
    lit = blocks.whole & (light > SHADOW * np.percentile(light[blocks.whole], 95, axis=0)).all(axis=-1)
    return _fit_of(_candidates(light, lit, blocks.outline, rig))


def _fit_of(candidates: list[_Candidate]) -> RigFit:
    """The fit of the first candidate, the rig itself, among all."""
    shares = orientation.probabilities(np.array([one.measures for one in candidates]))
    lights = np.array([one.lights for one in candidates])
    best = int(shares.argmax())

    def largest_angles(directions: F64) -> F64:
        """(N,) degrees from the light of each candidate that differs most."""
        return np.asarray(np.degrees(np.arccos(np.clip((lights * directions).sum(axis=2).min(axis=1), -1, 1))))

    from_stated, from_best, from_turned = (
        largest_angles(one) for one in (lights[0], lights[best], lights[best] * HALF_TURN_OF_LIGHTS)
    )
    stated = float(shares[from_stated < ALIKE].sum())
    # Only the outline distinguishes the best from itself turned by 180°.
    turned = from_turned < ALIKE
    right = from_best < ALIKE
    known = shares[right | turned].sum()
    if stated >= WRONG or known <= SURE or from_best[0] < MIN_DIFFERENCE or not candidates[best].measures[1]:
        return RigFit(stated)
    if not orientation.is_round(candidates[best].measures):
        if from_turned[0] < MIN_DIFFERENCE:
            return RigFit(stated)
        right |= turned
    named = [candidates[number] for number in np.flatnonzero(right)]
    fewest = min(one.changes for one in named)
    words = ", or ".join(one.words for one in named if one.changes == fewest)
    return RigFit(stated, words, lights[best])


def warn_of_wrong_rig(pixels: Floats, mask: Bools, rig: LightRig, which: str) -> None:
    """Warn if a rig does not fit its photo. which: the beginning of the message. Others as in :func:`check_rig`."""
    better = check_rig(pixels, mask, rig).better
    if better:
        log.warning("%s%s", which, misfit_words(better))


def misfit_words(better: str) -> Note:
    """A sentence on a rig that does not fit. better: as in :class:`RigFit`."""
    return Note(
        "the rig does not fit the photo: by its shading, %s; correct the rig file, or use the photo as the camera took "
        "it [wrong-rig]",
        better,
    )


def _order_words(order: tuple[int, ...]) -> str:
    moved = [number for number in range(3) if order[number] != number]
    if not moved:
        return ""
    if len(moved) == 2:
        return f"the {CHANNELS[moved[0]]} and {CHANNELS[moved[1]]} lights are swapped"
    first, second, third = (CHANNELS[number] for number in order)
    return f"the red, green and blue channels show the rig's {first}, {second} and {third} lights"


def _candidates(light: F64, lit: Bools, outline: orientation.Outline, rig: LightRig) -> list[_Candidate]:
    """The lights in all orders, the rig's own first, and turned. Normals by those of one order are the same, turned.

    light: (H, W, 3) unmixed means of blocks, not below 0. lit: (H, W) those that all lights reach.
    """
    orders, bright, found = list(permutations(range(3))), light[lit], list[_Candidate]()
    ordered, enough = rig.directions[orders], len(bright) >= orientation.MIN_CELLS
    strengths = equal_albedo(bright[::3], ordered) if enough else np.ones((len(orders), 3))
    for order, lights, strength in zip(orders, ordered, strengths, strict=True):
        normals = normalised(light * strength @ np.linalg.inv(lights).T)
        measures = orientation.orientation_measures(normals, lit, outline)
        turned = [np.concatenate([lights[:, :2] @ turn.T, lights[:, 2:]], axis=1) for turn in orientation.TURNS]
        found += [_Candidate(order, turn, *both) for turn, both in enumerate(zip(turned, measures, strict=True))]
    return found


def equal_albedo(colours: F64, directions: F64) -> F64:
    """(..., 3) factors of colours (P, 3) that make their albedo by equation 2 as constant as possible.

    directions: (..., 3, 3) one light per row. The factors compensate for the unknown strengths of the lights, which
    would distort the normals.
    """
    means = np.median(colours, axis=0)
    square = np.linalg.inv(directions @ directions.swapaxes(-1, -2))
    strengths = np.zeros((*directions.shape[:-1], 1))
    for _ in range(ROUNDS):
        lights = (colours / means).T * np.exp(strengths)  # (..., 3, P)
        parts = square @ lights * lights
        length = parts.sum(axis=-2, keepdims=True)
        error = np.log(length) / 2
        weight = 1 / np.maximum(np.abs(error - np.median(error, axis=-1, keepdims=True)), 0.02)
        weight /= weight.sum(axis=-1, keepdims=True)
        error -= (weight * error).sum(axis=-1, keepdims=True)
        jacobian = parts / length
        jacobian -= (weight * jacobian).sum(axis=-1, keepdims=True)
        left = (weight * jacobian) @ jacobian.swapaxes(-1, -2) + STRENGTH_PRIOR * np.eye(3)
        right = (weight * jacobian) @ error.swapaxes(-1, -2) + STRENGTH_PRIOR * strengths
        step = np.linalg.solve(left, right)
        strengths = strengths - step
        if np.abs(step).max() < SETTLED:
            break
    return np.asarray(np.exp(strengths[..., 0]) / means)
