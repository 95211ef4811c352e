"""Detect balls in a photo: circles by a gradient-based Hough transform, then subpixel outlines."""

import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.mask_regions import box_sums, dilated
from mpsnet_core.arrays.resampling import bilinear, block_means
from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.calibrate.ball import Ball, Circle, fit_ball
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.camera import Camera

# --- A ball's outline in a photo, to subpixel precision, and how much of it is visible, robust to noise ---------------


# Search range around a circle, as shares of the radius: of successive rounds, and of the final fit.
REACHES = (0.12, 0.04)
CLOSE = 0.012
# Radius in pixels to which the photo is scaled down: for the rounds, and for the final fit.
ROUGHLY, FINELY = 50, 150
# A mirror's rim blends into the background, because reflectance goes to 1 at grazing angles. The radius may lose this
# many pixels.
FADING = 0.3
# Number of lines across the outline, sampling distance on them in pixels, and weights to average neighbouring lines.
LINES = 180
STEP = 0.5
BESIDE = (0.1, 0.2, 0.4, 0.2, 0.1)
# Number of lines, an arc of the outline, that together decide whether there is an edge.
ARC = 15
# Least gradient of an edge relative to the median around it: three standard deviations of noise.
CLEAR = 3 / 0.6745
# Lines to either side whose noise is averaged; range along them on which it is measured, as a share of the radius.
NOISE_LINES, NOISE_REACH = 10, 0.06


class Pyramid:
    """A photo's brightness, also reduced by 2, 4, 8 ..., each computed on first use."""

    def __init__(self, image: F32) -> None:
        self._levels = [image.sum(axis=-1, keepdims=True)]

    def level(self, radius: float, wanted: float) -> tuple[F32, int]:
        """(H, W) the smallest level where a circle of `radius` pixels has at least `wanted`, and its factor."""
        number = max(0, int(np.floor(np.log2(max(radius, 1) / wanted))))
        while len(self._levels) <= number:
            self._levels.append(block_means(self._levels[-1], 2))
        return self._levels[number][..., 0], 2**number


def near_outline(photo: Pyramid, ball: Ball) -> Ball:
    """Refine a roughly known ball.

    The outline is moved to where most of it lies on edges, even faint ones (after Daugman's integro-differential
    operator, "High confidence visual recognition of persons", PAMI 1993): a mirror ball's rim blends with the
    background, and what it mirrors has stronger edges.
    """
    for share in REACHES:
        ball = ball.nudged(*_edges(photo, ball, share, ROUGHLY).best_nudge())
    return ball


def sharp_outline(photo: Pyramid, ball: Ball, *, mirror: bool) -> Ball:
    """Fit a ball to the steepest points near a rough outline, and measure how much of the outline is visible.

    Raises GeometryError if no ball fits.
    """
    edges = _edges(photo, ball, CLOSE, FINELY)
    points, clear = edges.steepest()
    ball = fit_ball(points[clear], ball.camera, ball.radius)
    away = np.linalg.norm(points[:, None] - ball.outline(LINES)[None], axis=2).min(axis=1)
    seen = clear & (away < max(CLOSE / 2 * ball.circle.radius, 0.75))
    fading = np.diag([0, 0, FADING**2 if mirror else 0.0])
    return replace(ball, seen=float(seen.mean()), covariance=ball.covariance + fading)


@dataclass(frozen=True)
class _Edges:
    """Gradients of an image along lines across a ball's outline."""

    outline: F64
    """(LINES, 2). Points where the lines cross the outline, in the photo's pixels."""
    across: F64
    """(LINES, 2). Directions of the lines."""
    offsets: F64
    """(N,). Positions along each line, in pixels."""
    gradients: F64
    """(LINES, N). Gradients."""
    noise_levels: F64
    """(LINES,). Local median of the gradients."""
    has_edge: Bools
    """(LINES,). Whether the surrounding arc has an edge above noise within reach."""
    inside_photo: Bools
    """(LINES,). Whether the whole line is inside the photo."""
    reach: float
    """Distance to search on either side of the outline, in pixels."""
    step: float
    """Distance of the offsets, in pixels."""

    def best_nudge(self) -> tuple[float, float, float]:
        """Shift within reach that moves most of the outline onto edges: pixels right, down, and outwards."""
        # Saturate: strong edges must not outweigh faint ones.
        evidence = self.gradients / (self.gradients + 2 * self.noise_levels[:, None])
        evidence[~self.inside_photo] = 0
        evidence = np.pad(evidence, [(0, 0), (1, 1)])  # nothing beyond the lines' ends
        lines, length = evidence.shape
        best, span = np.zeros(3), self.reach / 2
        while span > 0.4 * self.step:
            grid = np.linspace(-span, span, 7)
            nudges = best + np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
            offsets = nudges[:, :2] @ self.across.T + nudges[:, 2:]
            place = np.rint((offsets - self.offsets[0]) / self.step).astype(int) + 1
            total = evidence.take(np.clip(place, 0, length - 1) + length * np.arange(lines)).sum(axis=1)
            best = nudges[total.argmax()]
            span /= 2.5
        return float(best[0]), float(best[1]), float(best[2])

    def steepest(self) -> tuple[F64, Bools]:
        """(N, 2) the steepest point on each line, interpolated, and (N,) whether it is an edge above noise."""
        weighted = self.gradients * np.exp(-((self.offsets / self.reach) ** 2))
        weighted *= np.abs(self.offsets) < self.reach + 2 * self.step
        best = np.clip(weighted.argmax(axis=1), 1, len(self.offsets) - 2)
        line = np.arange(len(best))
        before, here, after = (self.gradients[line, best + k] for k in (-1, 0, 1))
        bend = np.minimum(before - 2 * here + after, -1e-12)
        part = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
        points = self.outline + (self.offsets[best] + self.step * part)[:, None] * self.across
        return points, self.inside_photo & self.has_edge & (here > 0.05 * np.median(here))


def _edges(photo: Pyramid, ball: Ball, share: float, wanted: float) -> _Edges:
    """Gradients along lines across the ball's outline, to either side by `share` of its radius."""
    radius = ball.circle.radius
    picture, smaller = photo.level(radius, wanted)
    step = STEP * smaller
    reach = max(share * radius, 2.0 * smaller)
    # Average the pixels beside a line to reduce noise.
    points_per_line = 2 * int(np.pi * radius / smaller / LINES) + 1
    outline = ball.outline(LINES * points_per_line)
    along = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)  # outwards
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    count = int(np.ceil((max(reach, NOISE_REACH * radius) + 2 * step) / step))
    offsets = step * np.arange(-count, count + 1, dtype=np.float64)
    places = outline[:, None] + offsets[:, None] * across[:, None]
    fine = np.roll(bilinear(picture, *np.moveaxis(places / smaller, -1, 0)), points_per_line // 2, axis=0)
    profile = fine.reshape(LINES, points_per_line, -1).mean(axis=1)
    gradient = profile[:, 2:] - profile[:, :-2]
    gradients, noise_levels = _steepness(gradient, BESIDE)
    on_arc, noise_on_arc = _steepness(gradient, [1 / ARC] * ARC)
    near = np.abs(offsets[1:-1]) <= reach
    has_edge = on_arc[:, near].max(axis=1) > CLEAR * noise_on_arc
    outline, across = outline[::points_per_line], across[::points_per_line]
    height, width = picture.shape
    ends = outline[:, None] + np.array([-1, 1])[:, None] * (reach + step) * across[:, None]
    inside_photo = np.all((ends > smaller) & (ends < np.array([width - 1, height - 1]) * smaller), axis=(1, 2))
    return _Edges(outline, across, offsets[1:-1], gradients, noise_levels, has_edge, inside_photo, reach, step)


def _steepness(gradient: F64, weights: Sequence[float]) -> tuple[F64, F64]:
    """(LINES, N) gradients of weighted means of neighbouring lines, and (LINES,) their local median."""
    around = _ring(gradient, len(weights) // 2)
    gradients = np.abs(sum(weight * around[turn : turn + LINES] for turn, weight in enumerate(weights)))
    noise_levels = _ring(np.median(gradients, axis=1), NOISE_LINES)
    noise_levels = np.median(np.lib.stride_tricks.sliding_window_view(noise_levels, 2 * NOISE_LINES + 1), axis=1)
    return gradients, np.maximum(noise_levels, 1e-12)


def _ring(lines: F64, more: int) -> F64:
    """The lines of a closed outline, padded cyclically by `more` lines at both ends."""
    return np.concatenate([lines[-more:], lines, lines[:more]])


# Longer side of the image in which circles are detected.
SEARCHED_SIDE = 400
MIN_SIDE = 16
# Range of a ball's radius, as a share of the photo's shorter side.
SMALLEST, LARGEST = 0.04, 0.75
CANDIDATES = 12
# Circles whose centres and radii differ by less, as a share of the radius, are duplicates: of candidates, and after
# they were moved to outlines.
ALIKE, SAME = 0.1, 0.02
# A circle with less of its outline visible, or a larger residual (as a share of the radius), is not a ball.
MIN_SEEN = 0.2
ROUGHEST = 0.01
# Pixels above this share of the brightest are mirrored lights, if they are a small share of the photo.
BRIGHT = 0.5
MAX_BRIGHT = 0.03

# An overlapping circle with this share of the ball's score may be the ball instead.
RIVAL = 0.6

log = logging.getLogger(__name__)


def find_balls(image: F32, camera: Camera, *, count: int = 1, radius: float = 1.0, mirror: bool = True) -> list[Ball]:
    """The `count` balls in a photo, from left to right.

    image: (H, W, 3) linear. radius: of the balls, see :func:`fit_ball`. mirror: whether they mirror lights; each then
    contains some of the brightest pixels.

    Edges vote for circle centres along their gradients (after Yuen et al., "Comparative study of Hough transform
    methods for circle finding", 1990). The best circles are moved to the nearest outline, and large ones with a mostly
    visible outline are chosen. Warns of an overlapping circle that is nearly as likely. Raises GeometryError if fewer
    are found.
    """
    if min(image.shape[:2]) < MIN_SIDE:
        raise GeometryError(f"a photo of {image.shape[1]} x {image.shape[0]} pixels is too small to show a ball")
    step = max(1, int(np.ceil(max(image.shape[:2]) / SEARCHED_SIDE)))
    small = block_means(image, step)
    bright = _bright(small) if mirror else np.zeros(small.shape[:2], bool)
    photo = Pyramid(image)
    near: list[Ball] = []
    for circle in _circles(small, bright):
        whole = Circle(circle.x * step, circle.y * step, circle.radius * step)
        with suppress(GeometryError):
            ball = near_outline(photo, fit_ball(whole.points(), camera, radius))
            if all(_differ(ball.circle, other.circle, SAME) for other in near):
                near.append(ball)
    sharp: list[Ball] = []
    for ball in near:
        with suppress(GeometryError):
            sharp.append(sharp_outline(photo, ball, mirror=mirror))
    likely = [ball for ball in sharp if ball.seen >= MIN_SEEN and ball.residual <= ROUGHEST * ball.circle.radius]
    likely.sort(key=_score, reverse=True)
    balls: list[Ball] = []
    for ball in likely:
        if len(balls) < count and all(_are_separate(ball.circle, other.circle) for other in balls):
            balls.append(ball)
    if len(balls) < count:
        number = "no ball was" if not balls else f"only {len(balls)} of {count} balls were"
        raise GeometryError(f"{number} found in the photo; give the circle by hand (x,y,r), or a mask of the ball")
    for ball in balls:
        _warn_of_rival(ball, likely)
    return sorted(balls, key=lambda ball: ball.circle.x)


def _warn_of_rival(ball: Ball, likely: list[Ball]) -> None:
    """Warn of an overlapping circle that is nearly as likely to be the ball."""
    for other in likely:
        a, b = ball.circle, other.circle
        if _score(other) > RIVAL * _score(ball) and _differ(a, b, ALIKE) and not _are_separate(a, b):
            words = "the ball may be the circle %.0f,%.0f,%.0f or %.0f,%.0f,%.0f; the first was chosen: look at the "
            words += "overlay, and give the circle by hand (x,y,r) if it is not the ball's"
            log.warning(words, a.x, a.y, a.radius, b.x, b.y, b.radius)
            return


def _score(ball: Ball) -> float:
    return ball.seen**2 * float(np.sqrt(ball.circle.radius)) / (1 + ball.residual)


def _are_separate(a: Circle, b: Circle) -> bool:
    return float(np.hypot(a.x - b.x, a.y - b.y)) > 0.9 * (a.radius + b.radius)


def _smooth(picture: F32) -> F32:
    """Smooth with the binomial filter 1 4 6 4 1 in both directions."""
    for axis in (0, 1):
        around = np.pad(picture, [(2, 2) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        parts = np.lib.stride_tricks.sliding_window_view(around, 5, axis=axis)
        picture = (parts @ (np.array([1, 4, 6, 4, 1], np.float32) / 16)).astype(np.float32)
    return picture


def _bright(image: F32) -> Bools:
    """(H, W) the brightest pixels; none if they are too many to be mirrored lights."""
    brightness = image.max(axis=-1)
    bright = brightness > BRIGHT * brightness.max()
    return bright if bright.mean() < MAX_BRIGHT else np.zeros_like(bright)


def _circles(image: F32, bright: Bools) -> list[Circle]:
    """Candidate circles, sorted by votes relative to their size."""
    # Perceptual cube root: a mirror ball's outline is faint compared with the lights that it mirrors.
    picture = _smooth(np.cbrt(np.maximum(image.mean(axis=-1), 0)))
    height, width = picture.shape
    gradient_x, gradient_y = np.gradient(picture, axis=1), np.gradient(picture, axis=0)
    steep = np.hypot(gradient_x, gradient_y)
    edge = _ridge(steep, gradient_x, gradient_y) & ~dilated(bright, 4)
    edge &= steep > max(2.0 * float(np.median(steep)), 0.02 * float(np.percentile(steep, 99.5)))
    y, x = np.nonzero(edge)
    if len(x) == 0:
        return []
    # Each edge votes on both of its sides.
    across = np.concatenate([side * (gradient_x[edge] / steep[edge]) for side in (-1, 1)])
    along = np.concatenate([side * (gradient_y[edge] / steep[edge]) for side in (-1, 1)])
    x, y, shape = np.tile(x, 2), np.tile(y, 2), (height // 2 + 1, width // 2 + 1)
    shorter = min(height, width)
    found = []
    for size in np.arange(max(5.0, SMALLEST * shorter), LARGEST * shorter):
        column, row = (x + size * across).astype(int) >> 1, (y + size * along).astype(int) >> 1
        within = (column >= 0) & (column < shape[1]) & (row >= 0) & (row < shape[0])
        place = row[within] * shape[1] + column[within]
        votes = np.bincount(place, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)
        votes = box_sums(votes, 1 + int(size) // 40)
        for _ in range(2):  # there may be a second ball of the same size
            row, column = (int(place) for place in np.unravel_index(votes.argmax(), votes.shape))
            found.append((votes[row, column] / np.sqrt(size), Circle(2 * column + 1, 2 * row + 1, float(size))))
            by = int(size) // 2
            votes[max(row - by, 0) : row + by + 1, max(column - by, 0) : column + by + 1] = 0
    rows, columns = np.nonzero(bright)
    chosen: list[Circle] = []
    for _, circle in sorted(found, key=lambda pair: -pair[0]):
        if bright.any() and not (np.hypot(columns + 0.5 - circle.x, rows + 0.5 - circle.y) < circle.radius).any():
            continue
        if all(_differ(circle, other, ALIKE) for other in chosen):
            chosen.append(circle)
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _differ(a: Circle, b: Circle, share: float) -> bool:
    """Whether centres or radii differ by more than a share of the larger radius."""
    limit = share * max(a.radius, b.radius)
    return float(np.hypot(a.x - b.x, a.y - b.y)) > limit or abs(a.radius - b.radius) > limit


def _ridge(steep: F32, gradient_x: F32, gradient_y: F32) -> Bools:
    """(H, W) non-maximum suppression of the gradient along its direction, rounded to one of four."""
    eighth = np.round(np.arctan2(gradient_y, gradient_x) / (np.pi / 4)).astype(int) % 4
    around = np.pad(steep, 1)
    height, width = steep.shape
    top = np.zeros(steep.shape, bool)
    for number, (row, column) in enumerate(((0, 1), (1, 1), (1, 0), (1, -1))):
        ahead = around[1 + row : 1 + row + height, 1 + column : 1 + column + width]
        behind = around[1 - row : 1 - row + height, 1 - column : 1 - column + width]
        top |= (eighth == number) & (steep >= ahead) & (steep > behind)
    return top
