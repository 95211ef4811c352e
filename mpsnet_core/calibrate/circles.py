"""Finding balls in a photo: circles by the Hough transform along gradients, then their outlines to parts of a pixel."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.block_means import block_means
from mpsnet_core.calibrate.ball import Ball, Circle, fit_ball
from mpsnet_core.camera import Camera
from mpsnet_core.errors import InputError
from mpsnet_core.regions import box_sums, grown

# Longer side of the picture that circles are looked for in.
SEARCHED_SIDE = 400
LEAST_SIDE = 16
# A ball's radius, as a share of the photo's shorter side.
SMALLEST, LARGEST = 0.04, 0.75
CANDIDATES = 12
# How far from a circle its outline is looked for, as shares of the radius, round after round, and at last.
REACHES = (0.12, 0.04)
CLOSE = 0.012
# A mirror's rim fades into what stands behind it, as all surfaces mirror fully at grazing angles: so many pixels of its
# radius may be lost.
FADING = 0.3
# Pixels from place to place on a line across the outline, and the weights of lines beside each other.
STEP = 0.5
BESIDE = (0.1, 0.2, 0.4, 0.2, 0.1)
# With less of its outline, or one that is rougher (as a share of the radius), a circle is not a ball that was found.
LEAST_SEEN = 0.2
ROUGHEST = 0.01
# Above this share of the brightest pixel one belongs to a mirrored light, if those are a small part of the photo.
BRIGHT = 0.5
MOST_BRIGHT = 0.03


def find_balls(
    image: NDArray[np.float32], camera: Camera, *, count: int = 1, radius: float = 1.0, mirror: bool = True
) -> list[Ball]:
    """The `count` balls that a photo shows, from left to right.

    image: (H, W, 3) linear. radius: the balls' own, see :func:`fit_ball`. mirror: whether they mirror lights, so that
    each holds some of the brightest pixels.

    Edges vote for the middles of circles along their gradients (after Yuen et al., "Comparative study of Hough
    transform methods for circle finding", 1990); of the circles with most of an outline, the largest are fitted to
    what edge is nearest, by :func:`fit_ball`. Raises InputError where not as many are found.
    """
    if min(image.shape[:2]) < LEAST_SIDE:
        raise InputError(f"a photo of {image.shape[1]} x {image.shape[0]} pixels is too small to show a ball")
    step = max(1, int(np.ceil(max(image.shape[:2]) / SEARCHED_SIDE)))
    small = block_means(image, step)
    bright = _bright(small) if mirror else np.zeros(small.shape[:2], bool)
    found: list[tuple[float, Ball]] = []
    for circle in _circles(small, bright):
        whole = Circle(circle.x * step, circle.y * step, circle.radius * step)
        try:
            ball = outlined(image, whole, camera, radius=radius, mirror=mirror)
        except InputError:
            continue
        if ball.seen >= LEAST_SEEN and ball.residual <= ROUGHEST * ball.circle.radius:
            found.append((_score(ball), ball))
    balls: list[Ball] = []
    for _, ball in sorted(found, key=lambda pair: -pair[0]):
        if len(balls) < count and all(_apart(ball.circle, other.circle) for other in balls):
            balls.append(ball)
    if len(balls) < count:
        told = "no ball was" if not balls else f"only {len(balls)} of {count} balls were"
        raise InputError(f"{told} found in the photo; give the circle by hand (x,y,r), or a mask of the ball")
    return sorted(balls, key=lambda ball: ball.circle.x)


def outlined(
    image: NDArray[np.float32], circle: Circle, camera: Camera, *, radius: float = 1.0, mirror: bool = True
) -> Ball:
    """The ball near a circle, by the edges next to it, to parts of a pixel. Raises InputError where no ball fits.

    First the outline is moved to where most of it lies on edges, however faint (after Daugman's integro-differential
    operator, "High confidence visual recognition of persons", PAMI 1993): a mirror ball's rim blends with what stands
    behind it, and what it mirrors has stronger edges. Then the steepest places along it are fitted.
    """
    brightness = image.sum(axis=-1)
    ball = fit_ball(circle.points(), camera, radius)
    for share in REACHES:
        edges = _Edges(brightness, ball, max(share * ball.circle.radius, 2.0))
        ball = fit_ball(edges.best_outline(), camera, radius)
    edges = _Edges(brightness, ball, max(CLOSE * ball.circle.radius, 1.5))
    points, clear = edges.steepest()
    ball = fit_ball(points[clear], camera, radius)
    away = np.linalg.norm(points[:, None] - ball.outline[None], axis=2).min(axis=1)
    seen = clear & (away < max(CLOSE / 2 * ball.circle.radius, 0.75))
    fading = np.diag([0, 0, FADING**2 if mirror else 0.0])
    return replace(ball, seen=float(seen.mean()), covariance=ball.covariance + fading)


def _score(ball: Ball) -> float:
    return ball.seen**2 * float(np.sqrt(ball.circle.radius)) / (1 + ball.residual)


def _apart(a: Circle, b: Circle) -> bool:
    return float(np.hypot(a.x - b.x, a.y - b.y)) > 0.9 * (a.radius + b.radius)


def _smooth(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Under the binomial filter 1 4 6 4 1, twice as wide as a pixel."""
    for axis in (0, 1):
        around = np.pad(picture, [(2, 2) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        parts = np.lib.stride_tricks.sliding_window_view(around, 5, axis=axis)
        picture = (parts @ (np.array([1, 4, 6, 4, 1], np.float32) / 16)).astype(np.float32)
    return picture


def _bright(image: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) where the brightest pixels are; nowhere, where they are too many to be mirrored lights."""
    brightness = image.max(axis=-1)
    bright = brightness > BRIGHT * brightness.max()
    return bright if bright.mean() < MOST_BRIGHT else np.zeros_like(bright)


def _circles(image: NDArray[np.float32], bright: NDArray[np.bool_]) -> list[Circle]:
    """Circles that many edges vote for, most votes for their size first."""
    # The eye's cube root: a mirror ball's outline is faint beside the lights that it mirrors.
    picture = _smooth(np.cbrt(np.maximum(image.mean(axis=-1), 0)))
    height, width = picture.shape
    slope_y, slope_x = np.gradient(picture)
    steep = np.hypot(slope_x, slope_y)
    edge = _ridge(steep, slope_x, slope_y) & ~grown(bright, 4)
    edge &= steep > max(2.0 * float(np.median(steep)), 0.02 * float(np.percentile(steep, 99.5)))
    y, x = np.nonzero(edge)
    if len(x) == 0:
        return []
    across = slope_x[edge] / steep[edge], slope_y[edge] / steep[edge]
    shorter = min(height, width)
    found = []
    radii = np.arange(max(5.0, SMALLEST * shorter), LARGEST * shorter)
    for size in radii:
        shape = height // 2 + 1, width // 2 + 1
        votes = np.zeros(shape)
        for side in (-size, size):
            column, row = (x + side * across[0]).astype(int) // 2, (y + side * across[1]).astype(int) // 2
            within = (column >= 0) & (column < votes.shape[1]) & (row >= 0) & (row < votes.shape[0])
            place = np.ravel_multi_index((row[within], column[within]), shape)
            votes += np.bincount(place, minlength=votes.size).reshape(shape)
        votes = box_sums(votes, 1 + int(size) // 40)
        for _ in range(2):  # a second ball of the same size stands elsewhere
            row, column = (int(place) for place in np.unravel_index(votes.argmax(), votes.shape))
            found.append((votes[row, column] / np.sqrt(size), Circle(2 * column + 1, 2 * row + 1, float(size))))
            gone = int(size) // 2
            votes[max(row - gone, 0) : row + gone + 1, max(column - gone, 0) : column + gone + 1] = 0
    rows, columns = np.nonzero(bright)
    chosen: list[Circle] = []
    for _, circle in sorted(found, key=lambda pair: -pair[0]):
        if bright.any() and not (np.hypot(columns + 0.5 - circle.x, rows + 0.5 - circle.y) < circle.radius).any():
            continue
        if all(_differ(circle, other) for other in chosen):
            chosen.append(circle)
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _differ(a: Circle, b: Circle) -> bool:
    limit = 0.1 * max(a.radius, b.radius)
    return float(np.hypot(a.x - b.x, a.y - b.y)) > limit or abs(a.radius - b.radius) > limit


def _ridge(steep: NDArray[np.float32], slope_x: NDArray[np.float32], slope_y: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) where the slope is steepest along its own direction, to the nearest of four."""
    eighth = np.round(np.arctan2(slope_y, slope_x) / (np.pi / 4)).astype(int) % 4
    around = np.pad(steep, 1)
    height, width = steep.shape
    top = np.zeros(steep.shape, bool)
    for number, (row, column) in enumerate(((0, 1), (1, 1), (1, 0), (1, -1))):
        ahead = around[1 + row : 1 + row + height, 1 + column : 1 + column + width]
        behind = around[1 - row : 1 - row + height, 1 - column : 1 - column + width]
        top |= (eighth == number) & (steep >= ahead) & (steep > behind)
    return top


class _Edges:
    """How steep a picture is along lines across a ball's outline."""

    def __init__(self, brightness: NDArray[np.float32], ball: Ball, reach: float) -> None:
        self.outline = ball.outline
        along = np.roll(self.outline, -1, axis=0) - np.roll(self.outline, 1, axis=0)
        self.across = np.stack([along[:, 1], -along[:, 0]], axis=-1)
        self.across /= np.linalg.norm(self.across, axis=1, keepdims=True)
        offsets = np.arange(-reach - 1.5, reach + 1.75, STEP)
        places = self.outline[:, None] + offsets[:, None] * self.across[:, None]
        profile = _sampled(brightness, places)
        # Neighbouring lines cross the same edge; their mean has less noise.
        around = np.stack([np.roll(profile, turn, axis=0) for turn in range(-2, 3)])
        profile = np.tensordot(BESIDE, around, axes=1)
        self.steep = np.abs(profile[:, 2:] - profile[:, :-2])
        self.offsets, self.reach = offsets[1:-1], reach
        height, width = brightness.shape
        self.whole = ((places > 1) & (places < [width - 1, height - 1])).all(axis=(1, 2))
        # Half of what is steepest anywhere: what is steeper counts little more, however strong it is.
        self.usual = max(float(np.median(self.steep[self.whole])) if self.whole.any() else 0.0, 1e-12)

    def best_outline(self) -> NDArray[np.float64]:
        """(N, 2) the outline shifted and grown, within reach, to where most of it lies on an edge."""
        evidence = self.steep / (self.steep + 2 * self.usual)
        evidence[~self.whole] = 0
        line = np.arange(len(evidence))
        best, span = np.zeros(3), self.reach / 2
        while span > 0.2:
            grid = np.linspace(-span, span, 7)
            nudges = best + np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
            offsets = nudges[:, :2] @ self.across.T + nudges[:, 2:]
            place = np.rint((offsets - self.offsets[0]) / STEP).astype(int)
            within = (place >= 0) & (place < evidence.shape[1])
            total = np.where(within, evidence[line, np.clip(place, 0, evidence.shape[1] - 1)], 0).sum(axis=1)
            best = nudges[total.argmax()]
            span /= 2.5
        return (self.outline + (self.across @ best[:2] + best[2])[:, None] * self.across)[self.whole]

    def steepest(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 2) the steepest place on each line, to parts of a step, and (N,) whether it is an edge."""
        liked = self.steep * np.exp(-((self.offsets / self.reach) ** 2))
        best = np.clip(liked.argmax(axis=1), 1, len(self.offsets) - 2)
        line = np.arange(len(best))
        before, here, after = (self.steep[line, best + k] for k in (-1, 0, 1))
        bend = np.minimum(before - 2 * here + after, -1e-12)
        part = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
        points = self.outline + (self.offsets[best] + STEP * part)[:, None] * self.across
        return points, self.whole & (here > 1.5 * np.median(self.steep, axis=1)) & (here > 0.05 * np.median(here))


def _sampled(picture: NDArray[np.float32], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bilinear values of a picture (H, W) at places (..., 2) in pixels."""
    height, width = picture.shape
    x, y = np.clip(places[..., 0] - 0.5, 0, width - 1.001), np.clip(places[..., 1] - 0.5, 0, height - 1.001)
    column, row = x.astype(int), y.astype(int)
    fx, fy = x - column, y - row
    above = picture[row, column] * (1 - fx) + picture[row, column + 1] * fx
    below = picture[row + 1, column] * (1 - fx) + picture[row + 1, column + 1] * fx
    return above * (1 - fy) + below * fy
