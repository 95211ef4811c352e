"""The mixing matrix from lights to camera channels, from a matt grey ball or card under the rig."""

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.statistics import DEVIATIONS, biweight, deviation
from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.arrays.unit_vectors import angular_error, dot, normalised
from mpsnet_core.calibrate.ball import Ball, surface
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import Image
from mpsnet_core.scene.rig import LIGHT_NAMES, LightRig
from mpsnet_core.scene.rig_check import check_rig, misfit_words

log = logging.getLogger(__name__)

# Share of the ball's radius to use: the rim is blurred, and reflection of grazing light is not Lambertian.
USED_RADIUS = 0.9
# Enough pixels for a matrix; more are subsampled.
MAX_PIXELS = 10_000
MIN_PIXELS = 200
ROUNDS = 20
# Largest shift of the outline per round, in pixels.
MAX_NUDGE = 2.0
# Other unknowns to refine: the outline's centre and radius in pixels, two rotations of each light in radians, and the
# exponent of the cosine minus Lambert's 1. Prior standard deviations of the last seven (2°; a rough ball has 0.9).
OTHERS = 10
UNCERTAINTIES = [0.035] * 6 + [0.1]
# Steps of the finite differences. A rotation of a light changes its own shading alone, so those of the three lights are
# tried together.
STEPS = np.array([0.1] * 3 + [0.002] * 7)
TOGETHER = [0], [1], [2], [3, 5, 7], [4, 6, 8], [9]
# Model errors (gloss, interreflections) are correlated over much of the ball. Together, all pixels determine the lights
# as well as this many with independent errors.
INDEPENDENT = 300
# Model errors differ between parts of the ball. Leaving out each of these sectors in turn (jackknife) shows their
# effect on the matrix.
SECTORS = 6
# The matrix is undetermined if an off-diagonal entry has a larger standard deviation, relative to the largest entry.
# 97% of determined matrices are within 0.1: DiLiGenT's ball and glossy ones, lights known to 2°, 8-bit photos.
UNDETERMINED = 0.06
# If a larger share of the photo's variance is unexplained, it shows something else.
FOREIGN = 0.5
# Light that arrives at a smaller cosine does not determine its strength reliably.
MIN_COSINE = 0.1
# Largest residual, as a share of the brightness, of a model that describes the photo.
POOR = 0.05
AMBIENT = 0.03


@dataclass(frozen=True, eq=False)
class MixingFound:
    """A mixing matrix and how well it describes the photo."""

    mixing: F64
    """(3, 3) float64. Rows are the camera channels red, green, blue, columns the lights in rig order. The largest entry
    is 1. It includes brightness: the weaker of two lights has the smaller column."""
    residual: float
    """RMS residual of the fit, as a share of the mean brightness."""
    ambient: F64
    """(3,) float64. Ambient light, in the unit of the matrix; 0 for a card, which does not determine it."""
    pixels: int
    """Number of pixels used, without clipped ones."""
    left_out: float
    """Share of these that are outliers, such as highlights and stains."""
    ball: Ball | None
    """The ball with its outline refined by the shading, or None for a card."""
    determined: bool = True
    """Whether the photo determines the whole matrix. If not, it is diagonal, with the lights' strengths only."""
    uncertainty: float = 0.0
    """Largest standard deviation of the off-diagonal entries, from the errors of ball and lights, and from leaving out
    parts of the ball."""
    unexplained: float = 0.0
    """Share of the photo's variance that the fit leaves, outliers included."""


@takes_files
def mixing_from_ball(photo: Image, ball: Ball, rig: LightRig) -> MixingFound:
    """The mixing matrix from one photo of a matt grey ball under all three lights.

    Parameters
    ----------
    photo : Image
        Linear pixels (H, W, 3).
    ball : Ball
        The ball in the photo.
    rig : LightRig
        The lights; its mixing is ignored.

    Returns
    -------
    MixingFound

    Raises
    ------
    GeometryError
        If too few pixels are usable, or the rig's lights do not explain the photo.

    Notes
    -----
    Each channel is ``c_i = Σ_k M_ik max(n·l_k, 0) + a_i``, linear in M and the ambient light a. Both are fitted by
    non-negative least squares over the ball's pixels, with Tukey's biweight against outliers. The outline may be wrong
    by a pixel and the lights by a degree or two, and no ball is perfectly matt. So the same equations refine the
    outline's centre and radius, the lights' directions and the exponent of the cosine, within their uncertainties. If
    their remaining error could be mistaken for crosstalk, the result contains the lights' strengths only.
    """
    points, colours = _ball_pixels(photo, ball)
    found = _fitted(points, colours, ball, rig, np.ones((3, 3), bool))
    by_sectors = _by_sectors(points, colours, ball, rig, found)
    found = replace(found, uncertainty=float(np.hypot(found.uncertainty, by_sectors)))
    if found.uncertainty > UNDETERMINED:
        words = "this photo does not show how the lights' colours mix (to ± %.2f): the rig gets their strengths alone; "
        words += "for the rest take three photos, one under each light alone, or lights that stand wider apart"
        log.warning(words, found.uncertainty)
        alone = _fitted(points, colours, ball, rig, np.eye(3, dtype=bool))
        found = replace(alone, determined=False, uncertainty=found.uncertainty)
    return _checked(found)


def _fitted(points: F64, colours: F64, ball: Ball, rig: LightRig, allowed: Bools) -> MixingFound:
    """The matrix fitted to points (P, 2) and their colours (P, 3). allowed: (3, 3) entries that may be non-zero."""
    drawn, moved = ball, np.zeros(OTHERS)
    precision = np.diag([0.0] * 3 + [len(points) / INDEPENDENT / size**2 for size in UNCERTAINTIES])
    precision[:3, :3] = np.linalg.inv(ball.covariance)
    free = np.concatenate([np.concatenate([allowed.T, np.ones((1, 3), bool)]).T.ravel(), np.ones(OTHERS, bool)])
    weight: F64 = np.ones(colours.shape)
    scale = float(colours.std())
    answer = np.concatenate([np.diag(colours.max(axis=0)), np.zeros((1, 3))])
    at_ball = _surface(ball, rig, points)
    for turn in range(ROUNDS):
        basis = _shading(*at_ball, rig, moved[3:])
        jacobian = np.zeros((len(points), 3, OTHERS))
        if turn == 0:
            answer = _joint_step(basis, jacobian, colours, weight, np.eye(OTHERS), moved, free)[0]
        for numbers in TOGETHER:
            perturbed = moved.copy()
            perturbed[numbers] += STEPS[numbers]
            # Only the first three unknowns move the ball's surface.
            place, normal = _surface(drawn.nudged(*perturbed[:3]), rig, points) if numbers[0] < 3 else at_ball
            change = (_shading(place, normal, rig, perturbed[3:]) - basis) / STEPS[numbers[0]]
            for light, number in enumerate(numbers):
                changed = slice(light, light + 1) if len(numbers) > 1 else slice(None)
                jacobian[..., number] = change[:, changed] @ answer[changed]
        prior = precision * scale**2
        answer, step, left = _joint_step(basis, jacobian, colours, weight, prior, moved, free)
        step[:3] = np.clip(step[:3], -MAX_NUDGE, MAX_NUDGE)
        moved = moved + step
        ball = drawn.nudged(*moved[:3])
        at_ball = _surface(ball, rig, points)
        error = _shading(*at_ball, rig, moved[3:]) @ answer - colours
        scale = deviation(error[weight > 0])
        lighter = biweight(error, scale)
        settled = turn > 3 and np.abs(lighter - weight).mean() < 1e-3 and np.abs(step).max() < 1e-3
        weight = lighter
        if settled:
            break
    used = weight > 0
    largest = max(float(answer[:3].max()), 1e-12)
    variances = np.zeros(12 + OTHERS)
    variances[free] = np.diag(np.linalg.pinv(left[np.ix_(free, free)], hermitian=True))
    doubt = scale * np.sqrt(variances[:12] * len(points) / INDEPENDENT).reshape(3, 4)[:, :3] / largest
    residual = float(np.sqrt((weight * error**2).sum() / weight.sum()) / colours[used].mean())
    unsure, left_out = float(doubt[~np.eye(3, dtype=bool)].max()), float(1 - used.mean())
    unexplained, mixing = float((error**2).mean() / colours.var(axis=0).mean()), answer[:3].T / largest
    ambient = answer[3] / largest
    return MixingFound(mixing, residual, ambient, len(points), left_out, ball, True, unsure, unexplained)


def _by_sectors(points: F64, colours: F64, ball: Ball, rig: LightRig, found: MixingFound) -> float:
    """Largest standard deviation of the off-diagonal entries, by the jackknife (Tukey 1958) over the ball's sectors.

    points: (P, 2), and their colours: (P, 3), that `found` was fitted to.
    """
    x, y = (points - (ball.circle.x, ball.circle.y)).T
    sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS) % SECTORS
    variance = np.zeros((3, 3))
    for left_out in range(SECTORS):
        others = sector != left_out
        other = _fitted(points[others], colours[others], ball, rig, np.ones((3, 3), bool))
        variance += (SECTORS - 1) / SECTORS * (other.mixing - found.mixing) ** 2
    return float(np.sqrt(variance[~np.eye(3, dtype=bool)].max()))


def mixing_from_ball_by_light(photos: Sequence[Image], ball: Ball, rig: LightRig) -> MixingFound:
    """The mixing matrix from three photos of a matt grey ball, each under one light alone, in rig order.

    As :func:`mixing_from_ball`, but each photo determines the column of its light, so the lights' shadings need not be
    separated. All photos must have the same exposure. Raises GeometryError like :func:`mixing_from_ball`.
    """
    columns, ambient = [], []
    for light, photo in enumerate(_three_photos(photos)):
        points, colours = _ball_pixels(photo, ball)
        basis = _shading(*_surface(ball, rig, points), rig)
        shading = basis[:, light]
        lit = shading > MIN_COSINE
        if lit.sum() < MIN_PIXELS:
            raise GeometryError(f"the {LIGHT_NAMES[light]} light reaches too little of the ball; check rig and circle")
        ambient.append(_ambient(basis, colours, light))
        columns.append((colours[lit] - ambient[-1]) / shading[lit, None])
    return _from_columns(columns, ball, np.mean(ambient, axis=0))


def _ambient(basis: F64, colours: F64, light: int) -> F64:
    """(3,) ambient light, at least 0, in a photo of one light alone. basis: (P, 4), as `_shading` returns it."""
    free = np.zeros(12 + OTHERS, bool)
    free[:12].reshape(3, 4)[:, [light, 3]] = True
    still, unmoved, weight = np.zeros((len(basis), 3, OTHERS)), np.zeros(OTHERS), np.ones(colours.shape)
    for _ in range(ROUNDS):
        answer = _joint_step(basis, still, colours, weight, np.eye(OTHERS), unmoved, free)[0]
        error = basis @ answer - colours
        weight = biweight(error, deviation(error[weight > 0]))
    return np.asarray(answer[3])


def lambertian_error(photos: Sequence[Image], ball: Ball, rig: LightRig) -> float | None:
    """Mean angular error, in degrees, of Lambertian normals (equation 2) on a matt grey ball, with a calibrated rig.

    Computed where all three lights reach; None if that is nowhere. photos: one under all lights, or one of each. It
    includes errors that no mixing matrix corrects: wrong light directions, gloss, ambient light.
    """
    pixels = np.sum([photo.pixels for photo in photos], axis=0)
    clipped = np.any([photo.saturated for photo in photos], axis=0)
    points, colours = _ball_pixels(replace(photos[0], pixels=pixels, clipped=clipped), ball)
    place, normal = _surface(ball, rig, points)
    lit = (_shading(place, normal, rig)[:, :3] > MIN_COSINE).all(axis=1)
    if not lit.any():
        return None
    place, normal = place[lit], normal[lit]
    lights = np.broadcast_to(rig.lights_at(place), (len(place), 3, 3))
    found = np.linalg.solve(lights, rig.unmixed(colours[lit])[..., None])[..., 0]
    return float(angular_error(normalised(found), normal).mean())


def mixing_from_card(
    photos: Sequence[Image], mask: Bools, rig: LightRig, normal: ArrayLike = (0.0, 0.0, 1.0)
) -> MixingFound:
    """The mixing matrix from three photos of a matt grey card, each under one light alone, in rig order.

    photos: with the same exposure; one photo under all lights would give three values for nine unknowns. mask: (H, W)
    of the card. normal: (3,) of the card, in camera space. The card must be where the rig's directions are valid: where
    the ball was. Raises GeometryError if a light does not reach the card.
    """
    facing = normalised(np.asarray(normal, np.float64))
    cosines = rig.directions @ facing
    columns = []
    for light, photo in enumerate(_three_photos(photos)):
        if cosines[light] <= MIN_COSINE:
            raise GeometryError(f"the {LIGHT_NAMES[light]} light does not reach the card's face; check its normal")
        inside = photo.pixels[mask].astype(np.float64)
        usable = ~photo.saturated[mask].any(axis=1) & np.isfinite(inside).all(axis=1)
        if usable.sum() < MIN_PIXELS:
            words = f"the {LIGHT_NAMES[light]} light's photo has fewer than {MIN_PIXELS} usable pixels of the card"
            raise GeometryError(f"{words}; use a shorter exposure, or mark more of it")
        columns.append(inside[usable] / cosines[light])
    return _from_columns(columns, None)


def _three_photos(photos: Sequence[Image]) -> Sequence[Image]:
    if len(photos) != 3:
        raise SettingsError(f"{len(photos)} photo(s); give three, one under each light alone in the rig's order")
    return photos


def check_lights(image: F32, ball: Ball, rig: LightRig) -> None:
    """Raise GeometryError if another order or orientation of the lights fits the photo (H, W, 3) of a matt ball."""
    height, width = image.shape[:2]
    x, y = np.arange(width) + 0.5 - ball.circle.x, np.arange(height)[:, None] + 0.5 - ball.circle.y
    better = check_rig(np.nan_to_num(image, posinf=0), x**2 + y**2 < ball.circle.radius**2, rig).better
    if better:
        raise GeometryError(misfit_words(better))


def _ball_pixels(photo: Image, ball: Ball) -> tuple[F64, F64]:
    """Points (P, 2) well inside the ball and their colours (P, 3), without clipped ones."""
    height, width = photo.pixels.shape[:2]
    left, right, top, bottom = ball.window(width, height)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(left, right), np.arange(top, bottom)))
    points = np.stack([x, y], axis=-1).astype(np.float64) + 0.5
    if len(points):
        _, normal, back = surface(ball, points)
        inside = dot(normal, back) > np.sqrt(1 - USED_RADIUS**2)
        colours = photo.pixels[y, x].astype(np.float64)
        usable = inside & ~photo.saturated[y, x].any(axis=1) & np.isfinite(colours).all(axis=1)
        chosen = np.flatnonzero(usable)[:: max(1, int(usable.sum()) // MAX_PIXELS)]
    if not len(points) or len(chosen) < MIN_PIXELS:
        raise GeometryError(f"fewer than {MIN_PIXELS} pixels of the ball are usable; correct the circle or expose less")
    if not colours[chosen].any():
        raise GeometryError("the ball is black in the photo; were the lights on, and is the circle right?")
    return points[chosen], colours[chosen]


def _surface(ball: Ball, rig: LightRig, points: F64) -> tuple[F64, F64]:
    """Positions (P, 3) and unit normals (P, 3) of the ball's surface at points (P, 2) of the photo."""
    if rig.near is not None and ball.camera.projection == "orthographic":
        raise GeometryError("the rig's lights have positions; give the camera or its focal length, to see perspective")
    place, normal, _ = surface(ball, points)
    return place, normal


def _shading(place: F64, normal: F64, rig: LightRig, other: F64 | None = None) -> F64:
    """(P, 4) shading of a white matt surface by each light, at positions (P, 3) with unit normals (P, 3), and 1 for
    ambient light.

    other: (7,) two rotations of each light in radians, and the exponent of the cosine minus 1.
    """
    lights = rig.lights_at(place)
    exponent = 1.0
    if other is not None:
        across = normalised(np.cross(rig.directions, [0.6, 0.8, 0.0]))
        along = np.cross(across, rig.directions)
        turn = other[:6].reshape(3, 2)
        length = np.linalg.norm(lights, axis=-1, keepdims=True)
        lights = normalised(lights + length * (turn[:, :1] * along + turn[:, 1:] * across)) * length
        exponent += other[6]
    shading = np.maximum(np.einsum("...ki,...i->...k", lights, normal), 0) ** exponent
    return np.column_stack([shading, np.ones(len(place))])


def _joint_step(
    basis: F64, jacobian: F64, colours: F64, weight: F64, prior: F64, moved: F64, free: Bools
) -> tuple[F64, F64, F64]:
    """One Gauss-Newton step: the matrix with ambient light (4, 3), the step (10,) of outline, lights and exponent, and
    the normal equations (22, 22).

    basis: (P, 4). colours: (P, 3). jacobian: (P, 3, 10), derivatives of each channel. prior: (10, 10) precision of
    `moved` (10,), the sum of all steps so far. free: (22,) which unknowns may be non-zero.
    """
    left = np.zeros((12 + OTHERS, 12 + OTHERS))
    right = np.zeros(12 + OTHERS)
    for channel in range(3):
        rows = np.concatenate([basis, jacobian[:, channel]], axis=1)
        weighted = rows * weight[:, channel, None]
        unknowns = np.r_[4 * channel : 4 * channel + 4, 12 : 12 + OTHERS]
        left[np.ix_(unknowns, unknowns)] += weighted.T @ rows
        right[unknowns] += weighted.T @ colours[:, channel]
    left[12:, 12:] += prior
    right[12:] -= prior @ moved
    # Fix negative entries at zero, the most negative one first.
    free = free.copy()
    while True:
        solution = np.zeros(12 + OTHERS)
        solution[free] = np.linalg.lstsq(left[np.ix_(free, free)], right[free], rcond=1e-12)[0]
        worst = int(solution[:12].argmin())
        if solution[worst] >= 0:
            return solution[:12].reshape(3, 4).T, solution[12:], left
        free[worst] = False


def _from_columns(columns: Sequence[F64], ball: Ball | None, ambient: F64 | None = None) -> MixingFound:
    """The matrix whose columns are the medians of each light's `columns` (P, 3). ambient: (3,), in their unit."""
    middles = [np.maximum(np.median(values, axis=0), 0) for values in columns]
    mixing = np.stack(middles, axis=-1)
    if not mixing.max() > 0:
        raise GeometryError("the photos are black where the ball or card is; were the lights on?")
    off = [
        np.median(np.abs(values - middle)) / max(float(middle.max()), 1e-12)
        for values, middle in zip(columns, middles, strict=True)
    ]
    pixels, largest = sum(map(len, columns)), mixing.max()
    everywhere = np.zeros(3) if ambient is None else ambient / largest
    return _checked(MixingFound(mixing / largest, float(DEVIATIONS * np.mean(off)), everywhere, pixels, 0.0, ball))


def _checked(found: MixingFound) -> MixingFound:
    """Raise GeometryError for a matrix that cannot unmix photos; report what looks wrong."""
    mixing = found.mixing
    if not np.isfinite(mixing).all() or mixing.max() <= 0 or found.unexplained > FOREIGN:
        raise GeometryError(
            "no mixing matrix explains the photo; does the rig belong to this photo, is the circle right, and is the "
            "ball matt and grey, before dark surroundings?"
        )
    # The order with the largest product does not depend on the strengths of lights and channels.
    orders = itertools.permutations(range(3))
    if max(orders, key=lambda order: float(mixing[range(3), order].prod())) != (0, 1, 2):
        raise GeometryError(
            "the lights are not where the rig says; does the rig belong to this photo, with its lights in the "
            "order red, green, blue? [light-order]"
        )
    if found.residual > POOR:
        words = (
            "the matrix leaves %.0f%% of the brightness unexplained: is the ball or card matt, grey and evenly lit, "
        )
        log.warning(words + "and does the rig belong to this photo?", 100 * found.residual)
    if np.abs(found.ambient).max() > AMBIENT:
        words = "there is ambient light, %.0f%% as bright as the brightest lamp: darken the room, or subtract a photo "
        log.warning(words + "with the lamps off [room-light]", 100 * np.abs(found.ambient).max())
    return found
