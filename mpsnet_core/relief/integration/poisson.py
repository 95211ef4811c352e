"""Poisson's equation on a grid of pixels whose links to their neighbours count differently.

Outside the mask links count nothing, so the outline needs no care of its own, whatever its shape.
"""

import logging

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import labelled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.integration.multigrid import Grid, Links, corrected, grids_of, residual, smooth, steps_of

log = logging.getLogger(__name__)

# Iterations at most, up to a megapixel; of larger pictures fewer, so that they take no longer, but at least LEAST. One
# smooth surface takes about ten; one that hangs together by little alone, more than a hundred.
MOST, LEAST = 250, 60
# After LEAST of them a correction of so many pixels on the mean is enough: noise cuts single pixels off at rims, which
# alone would take a hundred more.
ENOUGH = 1e-3
# After so many, again and again, what rounding has added up to is taken out.
ROUNDED = 16
# A correction of so many pixels that is left after all of them is logged: along strips heights are off by up to a
# hundred times as much.
REPORTED = 0.02


def solved(
    weights: Links,
    pulls: Links,
    start: NDArray[np.float32],
    *,
    tolerance: float = 1e-4,
    most: int | None = None,
    progress: Progress = silent,
) -> NDArray[np.float32]:
    """(H, W) values u whose change over each link is as close as can be to pull / weight: least squares, so weighted.

    weights: 0 or above; pulls: the wanted change of each link times its weight. start: (H, W) first guess. Each part
    that hangs together keeps a constant of its own, which is any.

    Conjugate gradients with a multigrid cycle as preconditioner (Tatebe, "The multigrid preconditioned conjugate
    gradient method", 1993). It ends when the correction that is left is nowhere above `tolerance`, or above what
    float32 can hold, or after `most` iterations; unless these are given there are many, as long as it is above ENOUGH
    on the mean, and a note is logged where much is left after them.
    """
    grids = grids_of(weights)
    linked = np.count_nonzero(grids[0].step)
    unasked, most = most is None, most or max(LEAST, MOST * min(2**20, start.size) // start.size)
    u = start.copy()
    left = gathered(pulls)
    residual(grids[0], u, left, left)
    towards, along = np.zeros_like(u), np.empty_like(u)
    before, first, done = np.float32(1), 0.0, 0.0
    parts: tuple[NDArray[np.int32], NDArray[np.int64]] | None = None
    for number in range(most):
        if number % ROUNDED == ROUNDED - 1:
            parts = parts or labelled(grids[0].step > 0)
            _balance(left, *parts)
        correction = corrected(grids, left)
        remaining = float(np.abs(correction).max())
        if remaining <= tolerance + 1e-6 * float(np.abs(u).max()):
            break
        if unasked and number >= LEAST and float(np.abs(correction).sum()) <= ENOUGH * linked:
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
        if unasked and remaining > REPORTED:
            log.info(
                "the heights may be wrong by a few pixels where only thin strips connect the surface; use a "
                "mask without these strips, or a smaller image"
            )
    return u


def _balance(left: NDArray[np.float32], labels: NDArray[np.int32], sizes: NDArray[np.int64]) -> None:
    """Take the mean of each part (:func:`labelled`) out of a residual (H, W) that is 0 outside, in place.

    A part that hangs together has a constant of its own, for which nothing pulls. What rounding leaves there would grow
    with every iteration, until it is all that the solver follows.
    """
    sums = np.zeros(len(sizes))
    for rows in bands(len(left)):
        sums += np.bincount(labels[rows].ravel(), left[rows].ravel(), len(sizes))
    means = (sums / np.maximum(sizes, 1)).astype(np.float32)
    for rows in bands(len(left)):
        left[rows] -= means[labels[rows]]


def relaxed(
    weights: Links, pulls: Links, start: NDArray[np.float32], free: NDArray[np.bool_], times: int
) -> NDArray[np.float32]:
    """(H, W) what is nearer to :func:`solved` where `free` (H, W); elsewhere `start`. By so many Jacobi steps, each of
    which reaches a pixel's neighbours alone: for strips of a few pixels.
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
