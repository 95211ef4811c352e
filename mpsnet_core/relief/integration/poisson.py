"""Multigrid on a grid of linked pixels: coarse grids correct low-frequency errors, smoothing corrects the rest."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import labelled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64, Bools
from mpsnet_core.progress import Progress, silent

# Pixels per band: intermediate arrays stay in the CPU cache.
AT_ONCE = 1 << 16
# Damping of a Jacobi step; number of steps before and after the coarse-grid correction.
DAMPING, STEPS = np.float32(0.8), 2
# Grids up to this side are solved directly.
COARSEST = 4


@dataclass(frozen=True)
class Links:
    """A value for every pixel's link to the next one."""

    right: F32
    """(H, W - 1) float32. For the link to the pixel on the right."""
    down: F32
    """(H - 1, W) float32. For the link to the pixel below."""


@dataclass(frozen=True)
class Grid:
    """One level of the hierarchy."""

    links: Links
    """Weights of the links."""
    step: F32
    """(H, W) float32. Factors on the residual in a Jacobi step, 0 for pixels without links."""
    inverse: F32 | None = None
    """(H W, H W) float32. Inverse of the coarsest level's matrix, None for the other levels."""


def build_grids(weights: Links) -> list[Grid]:
    """The grid and successively coarser ones, each of blocks of 2 x 2 pixels of the one before."""
    grids = []
    while max(shape := (weights.right.shape[0], weights.down.shape[1])) > COARSEST:
        grids.append(Grid(weights, jacobi_factors(weights)))
        weights = _coarser_links(weights)
    matrix = _matrix(weights, *shape)
    inverse = np.linalg.pinv(matrix, 1e-6, hermitian=True).astype(np.float32)
    return [*grids, Grid(weights, jacobi_factors(weights), inverse)]


def residual(grid: Grid, u: F32, target: F32 | None, out: F32) -> F32:
    """Write target - A u to `out`, which may be `target`. A u sums weight * (u - neighbour) over a pixel's links.

    target: None for 0.
    """
    height, width = u.shape
    right, down = grid.links.right, grid.links.down
    for rows in bands(height, max(1, AT_ONCE // width)):
        top, end = rows.start, rows.stop
        band = out[rows]
        if target is not out:
            band[:] = 0 if target is None else target[rows]
        flow = u[rows, 1:] - u[rows, :-1]
        flow *= right[rows]
        band[:, :-1] += flow
        band[:, 1:] -= flow
        # Links from the row above the band to the row below it.
        first, last = max(top - 1, 0), min(end, height - 1)
        flow = u[first + 1 : last + 1] - u[first:last]
        flow *= down[first:last]
        band[: last - top] += flow[top - first :]
        band[first + 1 - top :] -= flow[: end - 1 - first]
    return out


def v_cycle(grids: list[Grid], residuals: F32, scratch: F32 | None = None) -> F32:
    """An approximate correction of u for its residuals: one V-cycle, symmetric for use as a preconditioner.

    scratch: (H, W) scratch memory, None to allocate it.
    """
    grid = grids[0]
    if grid.inverse is not None:
        return (grid.inverse @ residuals.ravel()).reshape(residuals.shape)
    u = residuals * grid.step
    scratch = np.empty_like(u) if scratch is None else scratch
    jacobi_steps(grid, u, residuals, scratch, STEPS - 1)
    prolong(u, v_cycle(grids[1:], restrict(residual(grid, u, residuals, scratch))))
    jacobi_steps(grid, u, residuals, scratch, STEPS)
    return u


def restrict(values: F32) -> F32:
    """(H / 2, W / 2) sums over blocks of 2 x 2 pixels, which may be incomplete at the right and the bottom."""
    height, width = values.shape
    pairs = values[0::2].copy()
    pairs[: height // 2] += values[1::2]
    sums = pairs[:, 0::2].copy()
    sums[:, : width // 2] += pairs[:, 1::2]
    return sums


def prolong(values: F32, blocks: F32) -> None:
    """Add to every pixel of (H, W) the value of its block of 2 x 2 pixels."""
    for row in (0, 1):
        for column in (0, 1):
            part = values[row::2, column::2]
            part += blocks[: part.shape[0], : part.shape[1]]


def jacobi_steps(grid: Grid, u: F32, target: F32, scratch: F32, times: int) -> None:
    """Take damped Jacobi steps of u towards A u = target, in place. scratch: (H, W) scratch memory."""
    for _ in range(times):
        residual(grid, u, target, scratch)
        scratch *= grid.step
        u += scratch


def jacobi_factors(links: Links) -> F32:
    """(H, W) factors on the residual in a Jacobi step, 0 for pixels without links."""
    sums = np.zeros((links.right.shape[0], links.down.shape[1]), np.float32)
    sums[:, 1:] += links.right
    sums[:, :-1] += links.right
    sums[1:] += links.down
    sums[:-1] += links.down
    return np.divide(DAMPING, sums, out=sums, where=sums > 0)


def _coarser_links(links: Links) -> Links:
    """The links between blocks: half the sum of the pixels' links, because the blocks' centres are twice as far apart.

    Without the half, a coarse grid of constant blocks corrects too little (Braess, "Towards algebraic multigrid for
    elliptic problems of second order", 1995).
    """
    right, down = links.right[:, 1::2], links.down[1::2]
    between = right[0::2].copy()
    between[: len(right) // 2] += right[1::2]
    below = down[:, 0::2].copy()
    below[:, : down.shape[1] // 2] += down[:, 1::2]
    return Links(between * np.float32(0.5), below * np.float32(0.5))


def _matrix(links: Links, height: int, width: int) -> F64:
    numbers = np.arange(height * width).reshape(height, width)
    matrix = np.zeros((height * width,) * 2)
    pairs = ((numbers[:, :-1], numbers[:, 1:], links.right), (numbers[:-1], numbers[1:], links.down))
    for one, other, weight in pairs:
        matrix[one.ravel(), other.ravel()] = matrix[other.ravel(), one.ravel()] = -weight.ravel()
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


# ----------------------------------------------------------------------------------------------------------------------
# Poisson's equation on a grid of pixels with weighted links to their neighbours.
#
# Links have weight 0 outside the mask, so outlines of any shape need no special treatment.


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
    weights: Links, sums: F32, start: F32, *, max_iterations: int | None = None, progress: Progress = silent
) -> F32:
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


def _remove_null_space(residuals: F32, labels: NDArray[np.integer[Any]], sizes: I64) -> None:
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


def relax_locally(weights: Links, weighted_changes: Links, start: F32, free: Bools, times: int) -> F32:
    """(H, W) an approximation of :func:`solve_poisson` where `free` (H, W), and `start` elsewhere.

    Each Jacobi step reaches a pixel's neighbours alone: suitable for strips of a few pixels.
    """
    u = start.copy()
    steps = jacobi_factors(weights)
    steps[~free] = 0
    jacobi_steps(Grid(weights, steps), u, right_side(weighted_changes), np.empty_like(u), times)
    return u


def right_side(weighted_changes: Links) -> F32:
    """(H, W) the right side of the normal equations: the sum of the weighted changes at each pixel."""
    sums = np.zeros((weighted_changes.right.shape[0], weighted_changes.down.shape[1]), np.float32)
    sums[:, 1:] += weighted_changes.right
    sums[:, :-1] -= weighted_changes.right
    sums[1:] += weighted_changes.down
    sums[:-1] -= weighted_changes.down
    return sums
