"""How the lights' colours mix into the camera's channels, by a matt grey ball or card under the rig."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.calibrate.ball import Ball, surface
from mpsnet_core.calibrate.robust import DEVIATIONS, biweight, spread
from mpsnet_core.errors import InputError
from mpsnet_core.images import Image
from mpsnet_core.normals import normalised
from mpsnet_core.rig import LIGHT_NAMES, LightRig

log = logging.getLogger(__name__)

# The ball is used to this share of its radius: its rim is blurred, and grazing light is not Lambert's.
USED_RADIUS = 0.9
# Pixels enough for a matrix; more of them are thinned out.
MOST_PIXELS = 40_000
LEAST_PIXELS = 200
ROUNDS = 20
# How far the outline is moved to measure what that does, and at most in a round, in pixels.
STEP = 0.1
MOST_NUDGE = 2.0
# Light that grazes tells little of its strength.
LEAST_COSINE = 0.1
# An entry may be below zero by as much as noise does.
NEGATIVE = 0.05
# Worse than this share of the brightness the model does not describe the photo.
POOR = 0.05
AMBIENT = 0.03


@dataclass(frozen=True)
class MixingFound:
    """A mixing matrix and how well it describes the photo.

    mixing: (3, 3): rows are the camera's channels red, green, blue, columns the lights in rig order; its largest entry
        is 1. It holds brightness too: of two lights the fainter has the smaller column.
    residual: rms of what it leaves unexplained, as a share of the mean brightness.
    ambient: (3,) light that comes from everywhere, in the matrix' unit; 0 for a card, which does not tell it.
    pixels: how many were looked at, clipped ones aside. left_out: share of these that fitted badly: highlights, stains.
    ball: with its outline put right by the shading, or None for a card.
    """

    mixing: NDArray[np.float64]
    residual: float
    ambient: NDArray[np.float64]
    pixels: int
    left_out: float
    ball: Ball | None


def mixing_from_ball(photo: Image, ball: Ball, rig: LightRig) -> MixingFound:
    """The mixing matrix from one photo of a matt grey ball under all three lights.

    rig: where the lights are; its own mixing is of no account.

    Each channel is ``c_i = Σ_k M_ik max(n·l_k, 0) + a_i``, linear in M and the ambient light a: least squares over the
    ball's pixels, those that fit badly left out by Tukey's biweight. As the normals hang on the outline, which may be
    off by a pixel, its middle and radius are put right in the same equations, as far as its own uncertainty allows.

    Raises InputError where too few pixels are usable or no matrix follows from them.
    """
    points, colours = _ball_pixels(photo, ball)
    weight: NDArray[np.float64] = np.ones(colours.shape)
    scale = np.inf
    for turn in range(ROUNDS):
        basis = _shading(ball, rig, points)
        if turn == 0:
            answer = np.linalg.lstsq(basis, colours, rcond=None)[0]
        slopes = [(_shading(ball.nudged(*nudge), rig, points) - basis) @ answer / STEP for nudge in STEP * np.eye(3)]
        answer, nudge = _joint_step(basis, np.stack(slopes, axis=-1), colours, weight, scale, ball.covariance)
        ball = ball.nudged(*np.clip(nudge, -MOST_NUDGE, MOST_NUDGE))
        error = _shading(ball, rig, points) @ answer - colours
        scale = spread(error, weight > 0)
        lighter = biweight(error, scale)
        settled = turn > 3 and np.abs(lighter - weight).mean() < 1e-3 and np.abs(nudge).max() < 1e-3
        weight = lighter
        if settled:
            break
    used = weight > 0
    return _checked(
        MixingFound(
            answer[:3].T / answer[:3].max(),
            float(np.sqrt((weight * error**2).sum() / weight.sum()) / colours[used].mean()),
            answer[3] / answer[:3].max(),
            len(points),
            float(1 - used.mean()),
            ball,
        )
    )


def mixing_from_ball_by_light(photos: Sequence[Image], ball: Ball, rig: LightRig) -> MixingFound:
    """The mixing matrix from three photos of a matt grey ball, each under one light alone, in rig order.

    As :func:`mixing_from_ball`, but every photo gives its light's column by itself, so that nothing rests on telling
    the lights' shadings apart. All photos have the same exposure. Raises InputError as there.
    """
    columns = []
    for light, photo in enumerate(_three_photos(photos)):
        points, colours = _ball_pixels(photo, ball)
        shading = _shading(ball, rig, points)[:, light]
        lit = shading > LEAST_COSINE
        if lit.sum() < LEAST_PIXELS:
            raise InputError(f"the {LIGHT_NAMES[light]} light reaches too little of the ball; check rig and circle")
        columns.append((colours[lit] / shading[lit, None], lit))
    return _from_columns([values for values, _ in columns], ball)


def mixing_from_card(
    photos: Sequence[Image], mask: NDArray[np.bool_], rig: LightRig, normal: ArrayLike = (0.0, 0.0, 1.0)
) -> MixingFound:
    """The mixing matrix from three photos of a matt grey card, each under one light alone, in rig order.

    photos: of the same exposure. mask: (H, W), where the card is. normal: (3,) which way it faces,
    in camera space. One photo under all lights would be three numbers for nine unknowns. The card stands where the
    rig's directions hold: where the ball stood. Raises InputError where a light does not reach the card.
    """
    facing = normalised(np.asarray(normal, np.float64))
    cosines = rig.directions @ facing
    columns = []
    for light, photo in enumerate(_three_photos(photos)):
        if cosines[light] <= LEAST_COSINE:
            raise InputError(f"the {LIGHT_NAMES[light]} light does not reach the card's face; check its normal")
        inside = photo.pixels[mask].astype(np.float64)
        usable = ~photo.saturated[mask].any(axis=1) & np.isfinite(inside).all(axis=1)
        if usable.sum() < LEAST_PIXELS:
            raise InputError(
                f"the photo of the {LIGHT_NAMES[light]} light has fewer than {LEAST_PIXELS} usable pixels of the card; "
                "expose shorter, or mark more of it"
            )
        columns.append(inside[usable] / cosines[light])
    return _from_columns(columns, None)


def _three_photos(photos: Sequence[Image]) -> Sequence[Image]:
    if len(photos) != 3:
        raise InputError(
            f"{len(photos)} photo(s) where three are needed, one under each light alone in the rig's order; one photo "
            "under all of them will do for a grey ball"
        )
    return photos


def _ball_pixels(photo: Image, ball: Ball) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (P, 2) well inside the ball and their colours (P, 3), without those that are clipped."""
    height, width = photo.pixels.shape[:2]
    left, right, top, bottom = ball.window(width, height)
    x, y = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
    x, y = x.ravel(), y.ravel()
    points = np.stack([x, y], axis=-1) + 0.5
    if len(points):
        _, normal, back = surface(ball, points)
        inside = np.einsum("ni,ni->n", normal, back) > np.sqrt(1 - USED_RADIUS**2)
        colours = photo.pixels[y, x].astype(np.float64)
        usable = inside & ~photo.saturated[y, x].any(axis=1) & np.isfinite(colours).all(axis=1)
        chosen = np.flatnonzero(usable)[:: max(1, int(usable.sum()) // MOST_PIXELS)]
    if not len(points) or len(chosen) < LEAST_PIXELS:
        raise InputError(
            f"the photo has fewer than {LEAST_PIXELS} usable pixels of the ball; is the circle right, and is it not "
            "overexposed?"
        )
    if not colours[chosen].any():
        raise InputError("the ball is black in the photo; were the lights on, and is the circle right?")
    return points[chosen], colours[chosen]


def _shading(ball: Ball, rig: LightRig, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P, 4) how much of each light a white matt surface sends back at points of the ball, and 1 for ambient light."""
    if rig.near is not None and ball.camera.projection == "orthographic":
        raise InputError(
            "the rig's lights have positions, which only a perspective camera sees; give the camera or its focal length"
        )
    place, normal, _ = surface(ball, points)
    lights = rig.directions if rig.near is None else rig.near.light_at(place)
    shading = np.einsum("...ki,...i->...k", lights, normal)
    return np.column_stack([np.maximum(shading, 0), np.ones(len(points))])


def _joint_step(
    basis: NDArray[np.float64],
    slopes: NDArray[np.float64],
    colours: NDArray[np.float64],
    weight: NDArray[np.float64],
    scale: float,
    covariance: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The matrix with ambient light (4, 3) and the outline's nudge (3,) that explain the colours (P, 3) best.

    basis: (P, 4). slopes: (P, 3, 3), what a pixel's nudge of x, y and radius does to each channel.
    """
    left = np.zeros((15, 15))
    right = np.zeros(15)
    for channel in range(3):
        rows = np.zeros((len(basis), 15))
        rows[:, 4 * channel : 4 * channel + 4] = basis
        rows[:, 12:] = slopes[:, channel]
        weighted = rows * weight[:, channel, None]
        left += weighted.T @ rows
        right += weighted.T @ colours[:, channel]
    if np.isfinite(scale):
        left[12:, 12:] += scale**2 * np.linalg.inv(covariance)
    solution = np.linalg.lstsq(left, right, rcond=1e-12)[0]
    return solution[:12].reshape(3, 4).T, solution[12:]


def _from_columns(columns: Sequence[NDArray[np.float64]], ball: Ball | None) -> MixingFound:
    """Each light's column is the median of what pixels (P, 3) say of it."""
    middles = [np.median(values, axis=0) for values in columns]
    mixing = np.stack(middles, axis=-1)
    if not mixing.max() > 0:
        raise InputError("the photos are black where the ball or card is; were the lights on?")
    off = [
        np.median(np.abs(values - middle)) / max(float(middle.max()), 1e-12)
        for values, middle in zip(columns, middles, strict=True)
    ]
    pixels = sum(map(len, columns))
    return _checked(
        MixingFound(mixing / mixing.max(), float(DEVIATIONS * np.mean(off)), np.zeros(3), pixels, 0.0, ball)
    )


def _checked(found: MixingFound) -> MixingFound:
    """Raises InputError for a matrix that no photo can be unmixed by; notes what looks wrong."""
    mixing = found.mixing
    if not np.isfinite(mixing).all() or mixing.max() <= 0 or (mixing < -NEGATIVE).any():
        raise InputError(
            "no mixing matrix explains the photo (one light would take light away); does the rig belong to this photo, "
            "with its lights in the order red, green, blue, and is the ball matt and grey, before dark surroundings? "
            "Pale ones throw light back at it"
        )
    if found.residual > POOR:
        log.warning(
            "the matrix leaves %.0f%% of the brightness unexplained: is the ball or card matt, grey and evenly lit, "
            "and does the rig belong to this photo?",
            100 * found.residual,
        )
    if np.abs(found.ambient).max() > AMBIENT:
        log.info(
            "there is light from everywhere, %.0f%% as bright as the brightest lamp: darken the room, or subtract a "
            "photo with the lamps off",
            100 * np.abs(found.ambient).max(),
        )
    return found
