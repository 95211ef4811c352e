"""A ball in camera space: its position from its outline, its surface normals, and mirrored directions."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.statistics import biweight, deviation
from mpsnet_core.arrays.types import F64, Bools
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.scene.camera import Camera

ROUNDS = 30
# Errors of neighbouring outline points are correlated; about one in this many is independent.
POINTS_THAT_AGREE = 4
# Least uncertainty of an outline in pixels: of one that was detected, and of one drawn by hand.
MIN_UNCERTAINTY = 0.03
HAND_UNCERTAINTY = 0.5
HAND_POINTS = 180
NO_FIT = "no ball fits the outline that was found; give the circle by hand (x,y,r)"


@dataclass(frozen=True)
class Circle:
    """A circle in a photo. Raises SettingsError if the radius is not above 0."""

    x: float
    """Centre, in pixels from the left."""
    y: float
    """Centre, in pixels from the top."""
    radius: float
    """Radius, in pixels."""

    def __post_init__(self) -> None:
        if not np.isfinite([self.x, self.y, self.radius]).all() or self.radius <= 0:
            raise SettingsError("a circle is x,y,r: finite numbers of pixels, with a radius above 0")

    def points(self, count: int = HAND_POINTS) -> F64:
        """(count, 2) evenly spaced points on the circle."""
        turn = 2 * np.pi * np.arange(count) / count
        return np.stack([self.x + self.radius * np.cos(turn), self.y + self.radius * np.sin(turn)], axis=-1)


@dataclass(frozen=True)
class Ball:
    """A ball in front of a camera."""

    centre: F64
    """(3,) float64. Position in camera space. With a perspective camera, in the unit of the given radius, else in ball
    radii. With an orthographic camera, in its world unit; the depth is unknown, and z is 0."""
    radius: float
    """Radius, in the same unit."""
    camera: Camera
    """The camera. Its pose is ignored here."""
    residual: float
    """RMS distance of the outline's inliers from the fit, in pixels."""
    seen: float
    """Share of the outline that was found, 0 to 1."""
    covariance: F64
    """(3, 3) float64. Covariance of the outline's centre x, y and radius, in pixels squared."""
    by_hand: bool = False
    """Whether the user drew the outline; residual and seen are then meaningless."""

    def outline(self, count: int = HAND_POINTS) -> F64:
        """(count, 2) points of the outline in the photo: a circle, or an ellipse under perspective."""
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
        """Bounding box of the outline in a photo of that size: left, right, top, bottom, as half-open ranges."""
        outline = self.outline()
        (low_x, low_y), (high_x, high_y) = outline.min(axis=0), outline.max(axis=0)
        left, right = max(int(low_x), 0), min(int(high_x) + 1, width)
        top, bottom = max(int(low_y), 0), min(int(high_y) + 1, height)
        return left, right, top, bottom

    @property
    def circle(self) -> Circle:
        """The circle with the outline's centre and area."""
        x, y = self.outline().T
        after_x, after_y = np.roll(x, -1), np.roll(y, -1)
        area = abs((x * after_y - after_x * y).sum()) / 2
        return Circle(float(x.mean()), float(y.mean()), float(np.sqrt(area / np.pi)))

    def nudged(self, x: float, y: float, radius: float) -> "Ball":
        """The ball whose outline is x pixels further right, y further down, and `radius` pixels larger."""
        shift = np.append(np.array([x, -y]) / self.camera.focal, 0)
        growth = radius / self.camera.focal.mean()
        if self.camera.projection == "orthographic":
            return replace(self, centre=self.centre + shift, radius=self.radius + growth)
        distance = np.linalg.norm(self.centre)
        axis = self.centre / -self.centre[2] + shift
        sine = np.sin(np.arcsin(self.radius / distance) + growth)
        return replace(self, centre=normalised(axis) * self.radius / sine)


def at_origin(camera: Camera) -> Camera:
    """The camera moved to the origin, because rigs are in camera space."""
    is_there = np.array_equal(camera.world_from_camera, np.eye(4))  # called thousands of times for one photo
    return camera if is_there else replace(camera, world_from_camera=np.eye(4))


def projected(camera: Camera, points: ArrayLike) -> F64:
    """(N, 2) pixels of camera-space points (N, 3)."""
    x, y, z = np.asarray(points, np.float64).T
    deep = 1.0 if camera.projection == "orthographic" else -z
    return np.stack([x / deep, -y / deep], axis=-1) * camera.focal + camera.centre


def fit_ball(points: ArrayLike, camera: Camera, radius: float = 1.0) -> Ball:
    """Robustly fit a ball to `points` (N, 2) of its outline in pixels.

    radius: of the ball, in the desired unit; not needed for an orthographic camera, which shows it.

    For a pinhole camera the outline is not a circle. The rays d tangent to the ball form a cone, d·a = cos α, about its
    axis a. Linear equations give a / cos α, and the ball is at distance radius / sin α along a. Tukey's biweight
    suppresses outliers. Raises GeometryError if no ball fits.
    """
    points = np.asarray(points, np.float64)
    weight: F64 = np.ones(len(points))
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
    variance = max(residual, MIN_UNCERTAINTY) ** 2 * POINTS_THAT_AGREE
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian) + MIN_UNCERTAINTY**2 * np.eye(3)
    bins = np.floor(np.arctan2(outward[:, 1], outward[:, 0]) / (2 * np.pi) * 72).astype(int) % 72
    return Ball(centre, size, camera, residual, len(np.unique(bins)) / 72, covariance)


def ball_from_circle(circle: Circle, camera: Camera, radius: float = 1.0) -> Ball:
    """The ball whose outline the user drew as a circle. Raises GeometryError if no ball fits."""
    ball = fit_ball(circle.points(), camera, radius)
    return replace(ball, covariance=HAND_UNCERTAINTY**2 * np.diag([0.5, 0.5, 0.5]), by_hand=True)


def ball_from_mask(mask: Bools, camera: Camera, radius: float = 1.0) -> Ball:
    """The ball in a mask (H, W), which may include its mount. Raises GeometryError if no ball fits."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) < 8 or len(columns) < 8:
        raise GeometryError("the mask shows no ball: it has fewer than 8 rows or columns; choose another mask")
    width, height = mask.shape[1], mask.shape[0]
    left, right = mask[rows].argmax(axis=1), width - mask[rows, ::-1].argmax(axis=1)
    top, bottom = mask[:, columns].argmax(axis=0), height - mask[::-1, columns].argmax(axis=0)
    sides = (left, rows + 0.5), (right, rows + 0.5), (columns + 0.5, top), (columns + 0.5, bottom)
    points = np.concatenate([np.stack(side, axis=-1) for side in sides])
    # Points on the image border do not belong to the outline.
    x, y = points.T
    return fit_ball(points[(x > 0) & (x < width) & (y > 0) & (y < height)], camera, radius)


def surface(ball: Ball, points: ArrayLike) -> tuple[F64, F64, F64]:
    """The ball's surface at points (N, 2) of the photo: position, unit normal and unit direction to the camera.

    Each is (N, 3) in camera space. Points outside the outline use the nearest tangent ray.
    """
    origins, away = at_origin(ball.camera).rays(np.atleast_2d(points))
    if ball.camera.projection == "orthographic":
        # Rays of an orthographic camera start at the depth of the ball's centre: move them in front of the ball.
        origins = origins - away * ball.radius * 2
    to_ball = ball.centre - origins
    along = dot(to_ball, away)
    squared = ball.radius**2 - (dot(to_ball, to_ball) - along**2)
    place = origins + (along - np.sqrt(np.maximum(squared, 0)))[:, None] * away
    return place, normalised(place - ball.centre), -away


def mirrored(ball: Ball, points: ArrayLike) -> tuple[F64, F64]:
    """Position on the ball and mirrored viewing direction at points (N, 2) of the photo; each (N, 3).

    The direction is 2 (n·v) n − v, where n is the normal and v the direction to the camera.
    """
    place, normal, back = surface(ball, points)
    return place, 2 * dot(normal, back)[:, None] * normal - back


def _solved(points: F64, weight: F64, camera: Camera, radius: float) -> tuple[F64, float]:
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


def _outline_error(points: F64, centre: F64, radius: float, camera: Camera) -> F64:
    """(N,) signed distance of points from the ball's outline in pixels, positive outside."""
    origins, away = at_origin(camera).rays(points)
    focal = float(camera.focal.mean())
    if camera.projection == "orthographic":
        across: F64 = np.linalg.norm(origins[:, :2] - centre[:2], axis=1) - radius
        return across * focal
    distance = np.linalg.norm(centre)
    sine_to_centre = np.linalg.norm(np.cross(away, centre / distance), axis=1)
    angle: F64 = np.arcsin(np.clip(sine_to_centre, 0, 1)) - np.arcsin(radius / distance)
    return angle * focal
