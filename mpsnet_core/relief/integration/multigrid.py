"""Multigrid on a grid of linked pixels: coarse grids correct low-frequency errors, smoothing corrects the rest."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64

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
    return [
        *grids,
        Grid(weights, jacobi_factors(weights), np.linalg.pinv(matrix, 1e-6, hermitian=True).astype(np.float32)),
    ]


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
