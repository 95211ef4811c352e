"""Detect balls in a photo: circles by a gradient-based Hough transform, then subpixel outlines."""

import logging
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import box_sums, dilated
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.calibrate.ball import Ball, Circle, fit_ball
from mpsnet_core.calibrate.outlines import Pyramid, near_outline, sharp_outline
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.camera import Camera

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


def find_balls(
    image: NDArray[np.float32], camera: Camera, *, count: int = 1, radius: float = 1.0, mirror: bool = True
) -> list[Ball]:
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
            log.warning(
                "the ball may be the circle %.0f,%.0f,%.0f or %.0f,%.0f,%.0f; the first was chosen: look at the "
                "overlay, and give the circle by hand (x,y,r) if it is not the ball's",
                *(a.x, a.y, a.radius, b.x, b.y, b.radius),
            )
            return


def _score(ball: Ball) -> float:
    return ball.seen**2 * float(np.sqrt(ball.circle.radius)) / (1 + ball.residual)


def _are_separate(a: Circle, b: Circle) -> bool:
    return float(np.hypot(a.x - b.x, a.y - b.y)) > 0.9 * (a.radius + b.radius)


def _smooth(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Smooth with the binomial filter 1 4 6 4 1 in both directions."""
    for axis in (0, 1):
        around = np.pad(picture, [(2, 2) if a == axis else (0, 0) for a in (0, 1)], mode="edge")
        parts = np.lib.stride_tricks.sliding_window_view(around, 5, axis=axis)
        picture = (parts @ (np.array([1, 4, 6, 4, 1], np.float32) / 16)).astype(np.float32)
    return picture


def _bright(image: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) the brightest pixels; none if they are too many to be mirrored lights."""
    brightness = image.max(axis=-1)
    bright = brightness > BRIGHT * brightness.max()
    return bright if bright.mean() < MAX_BRIGHT else np.zeros_like(bright)


def _circles(image: NDArray[np.float32], bright: NDArray[np.bool_]) -> list[Circle]:
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
    across = gradient_x[edge] / steep[edge], gradient_y[edge] / steep[edge]
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
        for _ in range(2):  # there may be a second ball of the same size
            row, column = (int(place) for place in np.unravel_index(votes.argmax(), votes.shape))
            found.append((votes[row, column] / np.sqrt(size), Circle(2 * column + 1, 2 * row + 1, float(size))))
            suppressed = int(size) // 2
            votes[
                max(row - suppressed, 0) : row + suppressed + 1, max(column - suppressed, 0) : column + suppressed + 1
            ] = 0
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


def _ridge(
    steep: NDArray[np.float32], gradient_x: NDArray[np.float32], gradient_y: NDArray[np.float32]
) -> NDArray[np.bool_]:
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
