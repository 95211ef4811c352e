"""A ball's outline in a photo, to subpixel precision, and how much of it is visible, robust to noise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.resampling import bilinear, block_means
from mpsnet_core.calibrate.ball import Ball, fit_ball

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

    def __init__(self, image: NDArray[np.float32]) -> None:
        self._levels = [image.sum(axis=-1, keepdims=True)]

    def level(self, radius: float, wanted: float) -> tuple[NDArray[np.float32], int]:
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

    outline: NDArray[np.float64]
    """(LINES, 2). Points where the lines cross the outline, in the photo's pixels."""
    across: NDArray[np.float64]
    """(LINES, 2). Directions of the lines."""
    offsets: NDArray[np.float64]
    """(N,). Positions along each line, in pixels."""
    gradients: NDArray[np.float64]
    """(LINES, N). Gradients."""
    noise_levels: NDArray[np.float64]
    """(LINES,). Local median of the gradients."""
    has_edge: NDArray[np.bool_]
    """(LINES,). Whether the surrounding arc has an edge above noise within reach."""
    inside_photo: NDArray[np.bool_]
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
        line = np.arange(len(evidence))
        best, span = np.zeros(3), self.reach / 2
        while span > 0.4 * self.step:
            grid = np.linspace(-span, span, 7)
            nudges = best + np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
            offsets = nudges[:, :2] @ self.across.T + nudges[:, 2:]
            place = np.rint((offsets - self.offsets[0]) / self.step).astype(int)
            within = (place >= 0) & (place < evidence.shape[1])
            total = np.where(within, evidence[line, np.clip(place, 0, evidence.shape[1] - 1)], 0).sum(axis=1)
            best = nudges[total.argmax()]
            span /= 2.5
        return float(best[0]), float(best[1]), float(best[2])

    def steepest(self) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 2) the steepest point on each line, interpolated, and (N,) whether it is an edge above noise."""
        weighted = (
            self.gradients
            * np.exp(-((self.offsets / self.reach) ** 2))
            * (np.abs(self.offsets) < self.reach + 2 * self.step)
        )
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


def _steepness(
    gradient: NDArray[np.float64], weights: Sequence[float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(LINES, N) gradients of weighted means of neighbouring lines, and (LINES,) their local median."""
    around = _ring(gradient, len(weights) // 2)
    gradients = np.abs(sum(weight * around[turn : turn + LINES] for turn, weight in enumerate(weights)))
    noise_levels = _ring(np.median(gradients, axis=1), NOISE_LINES)
    noise_levels = np.median(np.lib.stride_tricks.sliding_window_view(noise_levels, 2 * NOISE_LINES + 1), axis=1)
    return gradients, np.maximum(noise_levels, 1e-12)


def _ring(lines: NDArray[np.float64], more: int) -> NDArray[np.float64]:
    """The lines of a closed outline, padded cyclically by `more` lines at both ends."""
    return np.concatenate([lines[-more:], lines, lines[:more]])
