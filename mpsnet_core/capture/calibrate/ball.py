"""Ball: where a ball stands before the camera, by its outline; which way its surface faces, and what it mirrors."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.robust_statistics import biweight, deviation
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.scene.camera import Camera

ROUNDS = 30
# Neighbouring points of an outline share their errors; about one in this many is independent.
POINTS_THAT_AGREE = 4
# No outline is known better than this, in pixels, nor one that was given by hand better than that.
LEAST_UNCERTAINTY = 0.03
HAND_UNCERTAINTY = 0.5
HAND_POINTS = 180
NO_FIT = "no ball fits the outline that was found; give the circle by hand (x,y,r)"


@dataclass(frozen=True)
class Circle:
    """A circle in a photo: middle and radius in pixels. Raises SettingsError where the radius is not above 0."""

    x: float
    y: float
    radius: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.x, self.y, self.radius]).all() or self.radius <= 0:
            raise SettingsError("a circle is x,y,r: finite numbers of pixels, with a radius above 0")

    def points(self, count: int = HAND_POINTS) -> NDArray[np.float64]:
        """(count, 2) points on it, evenly."""
        turn = 2 * np.pi * np.arange(count) / count
        return np.stack([self.x + self.radius * np.cos(turn), self.y + self.radius * np.sin(turn)], axis=-1)


@dataclass(frozen=True)
class Ball:
    """A ball before a camera.

    Attributes
    ----------
    centre : (3,) float64
        In camera space. Before a perspective camera in the unit in which the radius was given, ball radii otherwise.
        Before an orthographic one in the camera's world unit, and the depth is unknown: z is 0.
    radius
        In the same unit.
    camera
        Its pose is ignored here.
    residual
        How far the outline's points lie from the fit, in pixels (rms of the inliers).
    seen
        Share of the outline that was found, 0 to 1.
    covariance : (3, 3) float64
        Of the errors of the outline's middle x, y and radius, in pixels squared.
    by_hand
        Whether the user drew the outline; residual and seen then mean nothing.
    """

    centre: NDArray[np.float64]
    radius: float
    camera: Camera
    residual: float
    seen: float
    covariance: NDArray[np.float64]
    by_hand: bool = False

    def outline(self, count: int = HAND_POINTS) -> NDArray[np.float64]:
        """(count, 2) points of its outline in the photo: a circle, or the ellipse that perspective makes of it."""
        turn = 2 * np.pi * np.arange(count) / count
        if self.camera.projection == "orthographic":
            rim = self.radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
            return projected(self.camera, self.centre + rim)
        distance = np.linalg.norm(self.centre)
        axis = self.centre / distance
        right = normalised(np.cross([0.0, 1.0, 0.0], -axis))
        up = np.cross(-axis, right)
        sine = self.radius / distance
        around = np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * up
        return projected(self.camera, axis * np.sqrt(1 - sine**2) + sine * around)

    def window(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Where its outline lies in a photo of that size: left, right, top and bottom, as of half-open ranges."""
        outline = self.outline()
        (low_x, low_y), (high_x, high_y) = outline.min(axis=0), outline.max(axis=0)
        left, right = max(int(low_x), 0), min(int(high_x) + 1, width)
        top, bottom = max(int(low_y), 0), min(int(high_y) + 1, height)
        return left, right, top, bottom

    @property
    def circle(self) -> Circle:
        """The circle of the outline's own middle and area."""
        x, y = self.outline().T
        after_x, after_y = np.roll(x, -1), np.roll(y, -1)
        area = abs((x * after_y - after_x * y).sum()) / 2
        return Circle(float(x.mean()), float(y.mean()), float(np.sqrt(area / np.pi)))

    def nudged(self, x: float, y: float, radius: float) -> "Ball":
        """The ball whose outline lies x pixels to the right, y down, and is larger by `radius` pixels."""
        shift = np.append(np.array([x, -y]) / self.camera.focal, 0)
        growth = radius / self.camera.focal.mean()
        if self.camera.projection == "orthographic":
            return replace(self, centre=self.centre + shift, radius=self.radius + growth)
        distance = np.linalg.norm(self.centre)
        axis = self.centre / -self.centre[2] + shift
        sine = np.sin(np.arcsin(self.radius / distance) + growth)
        return replace(self, centre=normalised(axis) * self.radius / sine)


def at_origin(camera: Camera) -> Camera:
    """The camera at the origin: rigs are in its own space, wherever it stands in the world."""
    is_there = np.array_equal(camera.world_from_camera, np.eye(4))  # called thousands of times for one photo
    return camera if is_there else replace(camera, world_from_camera=np.eye(4))


def projected(camera: Camera, points: ArrayLike) -> NDArray[np.float64]:
    """(N, 2) where camera-space points (N, 3) lie in the photo, in pixels."""
    x, y, z = np.asarray(points, np.float64).T
    deep = 1.0 if camera.projection == "orthographic" else -z
    pixels: NDArray[np.float64] = np.stack([x / deep, -y / deep], axis=-1) * camera.focal + camera.centre
    return pixels


def fit_ball(points: ArrayLike, camera: Camera, radius: float = 1.0) -> Ball:
    """The ball whose outline runs through `points` (N, 2) in pixels, despite outliers.

    radius: the ball's own, in the wanted unit; an orthographic camera shows it by itself.

    Before a pinhole camera a ball's outline is no circle but the rays d that touch it lie on a cone: d·a = cos α about
    its axis a, so that a / cos α follows from linear equations; the ball is at distance radius / sin α along a.
    Outliers lose their weight by Tukey's biweight. Raises GeometryError where no ball fits.
    """
    points = np.asarray(points, np.float64)
    weight: NDArray[np.float64] = np.ones(len(points))
    for turn in range(ROUNDS):
        centre, size = _solved(points, weight, camera, radius)
        error = _outline_error(points, centre, size, camera)
        lighter = biweight(error, deviation(error[weight > 0], 1e-3))
        if np.abs(lighter - weight).max() < 1e-3 and turn > 3:
            break
        weight = lighter
    inliers = weight > 0
    residual = float(np.sqrt(np.mean(error[inliers] ** 2)))
    middle = projected(camera, centre[None])[0]
    outward = points[inliers] - middle
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    jacobian = np.column_stack([outward, np.ones(len(outward))])
    variance = max(residual, LEAST_UNCERTAINTY) ** 2 * POINTS_THAT_AGREE
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian) + LEAST_UNCERTAINTY**2 * np.eye(3)
    bins = np.floor(np.arctan2(outward[:, 1], outward[:, 0]) / (2 * np.pi) * 72).astype(int) % 72
    return Ball(centre, size, camera, residual, len(np.unique(bins)) / 72, covariance)


def ball_from_circle(circle: Circle, camera: Camera, radius: float = 1.0) -> Ball:
    """The ball whose outline the user drew as a circle. Raises GeometryError where no ball fits."""
    ball = fit_ball(circle.points(), camera, radius)
    return replace(ball, covariance=HAND_UNCERTAINTY**2 * np.diag([0.5, 0.5, 0.5]), by_hand=True)


def ball_from_mask(mask: NDArray[np.bool_], camera: Camera, radius: float = 1.0) -> Ball:
    """The ball that a mask (H, W) shows, with or without its mount. Raises GeometryError where no ball fits."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) < 8 or len(columns) < 8:
        raise GeometryError("the mask shows no ball: it has fewer than 8 rows or columns; choose another mask")
    width, height = mask.shape[1], mask.shape[0]
    left, right = mask[rows].argmax(axis=1), width - mask[rows, ::-1].argmax(axis=1)
    top, bottom = mask[:, columns].argmax(axis=0), height - mask[::-1, columns].argmax(axis=0)
    points = np.concatenate(
        [
            np.stack([left, rows + 0.5], axis=-1),
            np.stack([right, rows + 0.5], axis=-1),
            np.stack([columns + 0.5, top], axis=-1),
            np.stack([columns + 0.5, bottom], axis=-1),
        ]
    )
    # The photo's border is no outline.
    x, y = points.T
    return fit_ball(points[(x > 0) & (x < width) & (y > 0) & (y < height)], camera, radius)


def surface(ball: Ball, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The ball's surface at points (N, 2) of the photo: position, unit normal and unit direction back to the camera.

    Each is (N, 3) in camera space. Points outside the outline use the nearest ray that touches it.
    """
    origins, away = at_origin(ball.camera).rays(np.atleast_2d(points))
    if ball.camera.projection == "orthographic":
        # Rays start beside the ball's middle, which has no depth: bring them before it.
        origins = origins - away * ball.radius * 2
    to_ball = ball.centre - origins
    along = dot(to_ball, away)
    squared = ball.radius**2 - (dot(to_ball, to_ball) - along**2)
    place = origins + (along - np.sqrt(np.maximum(squared, 0)))[:, None] * away
    return place, normalised(place - ball.centre), -away


def mirrored(ball: Ball, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where on the ball, and towards where, the camera looks by way of its mirror at points (N, 2); each (N, 3).

    The direction is 2 (n·v) n − v, of the normal n and the direction v to the camera: twice as far from v as n is.
    """
    place, normal, back = surface(ball, points)
    return place, 2 * dot(normal, back)[:, None] * normal - back


def _solved(
    points: NDArray[np.float64], weight: NDArray[np.float64], camera: Camera, radius: float
) -> tuple[NDArray[np.float64], float]:
    if (weight > 0).sum() < 5:
        raise GeometryError(NO_FIT)
    origins, away = at_origin(camera).rays(points)
    root = np.sqrt(weight)
    if camera.projection == "orthographic":
        x, y = origins[:, 0], origins[:, 1]
        rows = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
        answer = np.linalg.lstsq(rows * root[:, None], (x**2 + y**2) * root, rcond=None)[0]
        squared = answer[2] + answer[0] ** 2 + answer[1] ** 2
        if not squared > 0:
            raise GeometryError(NO_FIT)
        return np.array([answer[0], answer[1], 0.0]), float(np.sqrt(squared))
    axis = np.linalg.lstsq(away * root[:, None], root, rcond=None)[0]
    length = float(np.linalg.norm(axis))
    if not length > 1:
        raise GeometryError(NO_FIT)
    return axis / length * radius / np.sqrt(1 - 1 / length**2), radius


def _outline_error(
    points: NDArray[np.float64], centre: NDArray[np.float64], radius: float, camera: Camera
) -> NDArray[np.float64]:
    """(N,) how far outside the ball's outline points lie, in pixels."""
    origins, away = at_origin(camera).rays(points)
    focal = float(camera.focal.mean())
    if camera.projection == "orthographic":
        across: NDArray[np.float64] = np.linalg.norm(origins[:, :2] - centre[:2], axis=1) - radius
        return across * focal
    distance = np.linalg.norm(centre)
    beside = np.linalg.norm(np.cross(away, centre / distance), axis=1)
    angle: NDArray[np.float64] = np.arcsin(np.clip(beside, 0, 1)) - np.arcsin(radius / distance)
    return angle * focal
