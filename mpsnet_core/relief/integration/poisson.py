"""Poisson's equation on a grid of pixels with weighted links to their neighbours.

Links have weight 0 outside the mask, so outlines of any shape need no special treatment.
"""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import labelled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.integration.multigrid import (
    Grid,
    Links,
    build_grids,
    jacobi_factors,
    jacobi_steps,
    residual,
    v_cycle,
)

log = logging.getLogger(__name__)

# Limit of iterations up to a megapixel. Larger images have fewer, for the same run time, but at least MIN_ITERATIONS. A
# smooth surface takes about ten, one whose parts are connected by thin strips more than a hundred.
MAX_ITERATIONS, MIN_ITERATIONS = 250, 60
# After MIN_ITERATIONS, stop once the mean correction is below this many pixels: noise isolates single pixels at rims,
# which would take a hundred more.
ENOUGH = 1e-3
# Accumulated rounding errors are removed after every so many iterations.
ROUNDED = 16
# The solution has converged once no correction is above this many pixels.
TOLERANCE = 1e-4
# A remaining correction above this many pixels is logged: along strips, heights may be wrong by a hundred times as
# much.
REPORTED = 0.02


def solve_poisson(
    weights: Links,
    sums: NDArray[np.float32],
    start: NDArray[np.float32],
    *,
    max_iterations: int | None = None,
    progress: Progress = silent,
) -> NDArray[np.float32]:
    """(H, W) weighted least-squares values u whose change over each link is closest to the wanted one.

    weights: 0 or above. sums: (H, W) :func:`right_side` of the wanted changes. start: (H, W) initial guess. Both are
    overwritten. Each connected part has an arbitrary constant.

    Conjugate gradients with a multigrid cycle as preconditioner (Tatebe, "The multigrid preconditioned conjugate
    gradient method", 1993). It ends when the correction is below TOLERANCE, or the precision of float32, everywhere,
    or after `max_iterations`. By default there are up to MAX_ITERATIONS; then it also ends once the mean correction is
    below ENOUGH, and logs a note if a large correction remains.
    """
    grids = build_grids(weights)
    linked = np.count_nonzero(grids[0].step)
    by_default = max_iterations is None
    if max_iterations is None:
        max_iterations = max(MIN_ITERATIONS, MAX_ITERATIONS * min(2**20, start.size) // start.size)
    parts, sizes = labelled(grids[0].step > 0)
    parts = parts.astype(np.min_scalar_type(len(sizes)))  # mostly bytes, for a large photo's memory
    u, residuals = start, residual(grids[0], start, sums, sums)
    direction, image = np.zeros_like(u), np.empty_like(u)
    last_product, first, done = np.float32(1), 0.0, 0.0
    for number in range(max_iterations):
        if number % ROUNDED == ROUNDED - 1:
            _remove_null_space(residuals, parts, sizes)
        correction = v_cycle(grids, residuals, image)
        largest = float(np.abs(u, out=image).max())
        remaining = float(np.abs(correction, out=image).max())
        if remaining <= TOLERANCE + 1e-6 * largest:
            break
        if by_default and number >= MIN_ITERATIONS and float(image.sum()) <= ENOUGH * linked:
            break
        first = max(first, remaining)
        gained = np.log(first / remaining) / max(np.log(first / TOLERANCE), 1e-6)
        # The correction may grow from one iteration to the next, but progress must not go back.
        done = max(done, number / max_iterations, min(float(gained), 1.0))
        progress(done, "integrating")
        product = np.vdot(residuals, correction)
        direction *= product / last_product
        direction += correction
        residual(grids[0], direction, None, image)
        step = product / -np.vdot(direction, image)
        image *= step
        residuals += image
        u += np.multiply(direction, step, out=image)
        last_product = product
        del correction  # before the next one is made
    else:
        if by_default and remaining > REPORTED:
            log.warning(
                "the heights may be wrong by a few pixels where only thin strips connect the surface; use a "
                "mask without these strips, or a smaller image"
            )
    return u


def _remove_null_space(
    residuals: NDArray[np.float32], labels: NDArray[np.integer[Any]], sizes: NDArray[np.int64]
) -> None:
    """Subtract the mean of each connected part (:func:`labelled`) from a residual (H, W), in place.

    The constant of a connected part is undetermined (the null space of the system). Rounding errors in it would grow
    with every iteration until they dominate.
    """
    sums = np.zeros(len(sizes))
    for rows in bands(len(residuals)):
        sums += np.bincount(labels[rows].ravel(), residuals[rows].ravel(), len(sizes))
    means = (sums / np.maximum(sizes, 1)).astype(np.float32)
    for rows in bands(len(residuals)):
        residuals[rows] -= means[labels[rows]]


def relax_locally(
    weights: Links, weighted_changes: Links, start: NDArray[np.float32], free: NDArray[np.bool_], times: int
) -> NDArray[np.float32]:
    """(H, W) an approximation of :func:`solve_poisson` where `free` (H, W), and `start` elsewhere.

    Each Jacobi step reaches a pixel's neighbours alone: suitable for strips of a few pixels.
    """
    u = start.copy()
    steps = jacobi_factors(weights)
    steps[~free] = 0
    jacobi_steps(Grid(weights, steps), u, right_side(weighted_changes), np.empty_like(u), times)
    return u


def right_side(weighted_changes: Links) -> NDArray[np.float32]:
    """(H, W) the right side of the normal equations: the sum of the weighted changes at each pixel."""
    sums = np.zeros((weighted_changes.right.shape[0], weighted_changes.down.shape[1]), np.float32)
    sums[:, 1:] += weighted_changes.right
    sums[:, :-1] -= weighted_changes.right
    sums[1:] += weighted_changes.down
    sums[:-1] -= weighted_changes.down
    return sums
