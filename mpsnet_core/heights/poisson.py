"""Poisson's equation on a grid of pixels whose links to their neighbours count differently.

Outside the mask links count nothing, so the outline needs no care of its own, whatever its shape.
"""

import logging

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.heights.multigrid import Grid, Links, corrected, grids_of, residual, smooth, steps_of
from mpsnet_core.progress import Progress, silent

log = logging.getLogger(__name__)

# Iterations at most. One smooth surface takes about ten; one that hangs together by little alone, more.
MOST = 40


def solved(
    weights: Links,
    pulls: Links,
    start: NDArray[np.float32],
    *,
    tolerance: float = 1e-4,
    most: int = MOST,
    progress: Progress = silent,
) -> NDArray[np.float32]:
    """(H, W) values u whose change over each link is as close as can be to pull / weight: least squares, so weighted.

    weights: 0 or above; pulls: the wanted change of each link times its weight. start: (H, W) first guess. Each part
    that hangs together keeps a constant of its own, which is any.

    Conjugate gradients with a multigrid cycle as preconditioner (Tatebe, "The multigrid preconditioned conjugate
    gradient method", 1993). It ends when the correction that is left is nowhere above `tolerance`, or above what
    float32 can hold, or after `most` iterations; after MOST a note says so.
    """
    grids = grids_of(weights)
    u = start.copy()
    left = gathered(pulls)
    residual(grids[0], u, left, left)
    towards, along = np.zeros_like(u), np.empty_like(u)
    before, first, done = np.float32(1), 0.0, 0.0
    for number in range(most):
        correction = corrected(grids, left)
        remaining = float(np.abs(correction).max())
        if remaining <= tolerance + 1e-6 * float(np.abs(u).max()):
            break
        first = max(first, remaining)
        gained = np.log(first / remaining) / max(np.log(first / tolerance), 1e-6)
        # A correction can be larger than the one before it; progress does not go back.
        done = max(done, number / most, min(float(gained), 1.0))
        progress(done, "integrating")
        now = np.vdot(left, correction)
        towards *= now / before
        towards += correction
        residual(grids[0], towards, None, along)
        step = now / -np.vdot(towards, along)
        u += step * towards
        left += step * along
        before = now
    else:
        if most >= MOST:
            log.info(
                "the heights may be off where the surface hangs together by thin strips: %d steps were too few", most
            )
    return u


def relaxed(
    weights: Links, pulls: Links, start: NDArray[np.float32], free: NDArray[np.bool_], times: int
) -> NDArray[np.float32]:
    """(H, W) what is nearer to :func:`solved` where `free` (H, W); elsewhere `start`. By so many Jacobi steps, each of
    which tells a pixel of its neighbours alone: for strips of a few pixels.
    """
    u = start.copy()
    steps = steps_of(weights)
    steps[~free] = 0
    smooth(Grid(weights, steps), u, gathered(pulls), np.empty_like(u), times)
    return u


def gathered(pulls: Links) -> NDArray[np.float32]:
    """(H, W) the right side of the normal equations: what pulls at each pixel, from all sides."""
    sums = np.zeros((pulls.right.shape[0], pulls.down.shape[1]), np.float32)
    sums[:, 1:] += pulls.right
    sums[:, :-1] -= pulls.right
    sums[1:] += pulls.down
    sums[:-1] -= pulls.down
    return sums
