"""Poisson's equation on the graph of a texture's texels, connected within UV islands and across their seams.

It finds the heights h that minimise sum w (h_j - h_i - d_ij)², for known differences d_ij between neighbours in the
texture and across its seams, plus s_i h_i² to hold low frequencies.

The solver for images (:mod:`mpsnet_core.relief.integration.poisson`) finds neighbours by their position, which makes it
several times as fast, but does not work across seams. Here each texel has a list of its neighbours. The method is the
same: conjugate gradients, preconditioned by a multigrid cycle. A coarser level merges the texels of one island in every
2 x 2 cells into one unknown; when every island is a single unknown, islands that share a seam are merged.
"""

import logging
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.mask_regions import connected
from mpsnet_core.arrays.types import F32, F64, I32, I64
from mpsnet_core.progress import Progress, silent

log = logging.getLogger(__name__)

# Weight of a step across a seam, relative to one between neighbours in the texture: a step at a seam is a crack.
TOGETHER = 4.0
# Fewer unknowns than this are solved directly.
DIRECT = 400
# Damping of Jacobi's method that best smooths what a level of 2 x 2 blocks cannot represent (2D Laplacian).
DAMPING = 0.8
# Relative residual at which the solver stops: far below the errors of any normals.
TOLERANCE = 1e-4
MAX_STEPS = 200


@dataclass(frozen=True)
class Graph:
    """The connections of N unknowns in the texture's cells: to grid neighbours, and by M ties between any two."""

    cells: I32
    """(N, 2). Row and column."""
    islands: I32
    """(N,). UV islands."""
    neighbours: I32
    """(4, N). The unknown to the right, below, to the left and above; its own index if there is none."""
    weights: F32
    """(4, N). Weights of these links; 0 if there is none."""
    ties: I32
    """(M, 2). The two unknowns of each tie."""
    tie_weights: F32
    """(M,). Weights of the ties."""
    hold: F32
    """(N,). Weights of h² itself."""

    def diagonal(self) -> F32:
        """(N,) the diagonal of the normal equations' matrix."""
        total: F32 = self.weights.sum(axis=0) + self.hold
        for end in self.ties.T:
            np.add.at(total, end, self.tie_weights)
        return total

    def times(self, heights: F32, diagonal: F32) -> F32:
        """(N,) the normal equations' matrix times `heights`."""
        out: F32 = diagonal * heights
        for neighbour, weight in zip(self.neighbours, self.weights, strict=True):
            out -= weight * heights[neighbour]
        one, other = self.ties.T
        np.subtract.at(out, one, self.tie_weights * heights[other])
        np.subtract.at(out, other, self.tie_weights * heights[one])
        return out

    def right_side(self, right: F32, below: F32, across: F32) -> F32:
        """(N,) the right side of the normal equations for known differences: to the neighbours on the right and below,
        (N,) each, and over the ties, (M,), from the first to the second."""
        out = np.zeros(len(self.islands), np.float32)
        for axis, known in enumerate((right, below)):
            out -= self.weights[axis] * known
            back = self.neighbours[axis + 2]
            out += self.weights[axis + 2] * known[back]
        np.subtract.at(out, self.ties[:, 0], self.tie_weights * across)
        np.add.at(out, self.ties[:, 1], self.tie_weights * across)
        return out


def graph_of(islands: I32, ties: I32, hold: F32) -> Graph:
    """The graph of a texture's N covered texels in row-major order.

    islands: (S, S) the island of each texel, -1 for none. ties: (M, 2). hold: (N,).
    """
    covered = islands >= 0
    cells = np.argwhere(covered).astype(np.int32)
    number = np.full(islands.shape, -1, np.int32)
    number[covered] = np.arange(len(cells), dtype=np.int32)
    own = np.arange(len(cells), dtype=np.int32)
    neighbours = np.repeat(own[None], 4, axis=0)
    for axis in (0, 1):
        along = np.moveaxis(islands, 1 - axis, 0), np.moveaxis(number, 1 - axis, 0)
        same = (along[0][:-1] >= 0) & (along[0][:-1] == along[0][1:])
        one, other = along[1][:-1][same], along[1][1:][same]
        neighbours[axis, one], neighbours[axis + 2, other] = other, one
    weights = (neighbours != own).astype(np.float32)
    return Graph(cells, islands[covered], neighbours, weights, ties, np.full(len(ties), TOGETHER, np.float32), hold)


class Solver:
    """Solves a graph's normal equations for any right side. A connected part without hold is determined up to a
    constant."""

    def __init__(self, graph: Graph) -> None:
        self.levels = [_Level(graph, graph.diagonal(), None)]
        while len(self.levels[-1].graph.islands) > DIRECT:
            fine = self.levels[-1]
            parent = _parents(fine.graph)
            coarse = _coarser(fine.graph, parent)
            if len(coarse.islands) == len(parent):
                break
            self.levels[-1] = _Level(fine.graph, fine.diagonal, parent)
            self.levels.append(_Level(coarse, coarse.diagonal(), None))
        last = self.levels[-1].graph
        self.inverse = _pseudo_inverse(last) if len(last.islands) <= DIRECT else None

    def solve(self, right_side: F32, start: F32, progress: Progress = silent) -> F32:
        """(N,) the heights. start: initial guess.

        Flexible conjugate gradients (Notay 2000): the cycle in float32 is not quite symmetric.
        """
        level = self.levels[0]
        heights = start.copy()
        residual = right_side - level.graph.times(heights, level.diagonal)
        first = max(_dot(right_side, right_side), 1e-30) ** 0.5
        direction = before = np.zeros_like(heights)
        scale = 1.0
        for _ in range(MAX_STEPS):
            left = _dot(residual, residual) ** 0.5 / first
            progress(float(np.clip(np.log(max(left, TOLERANCE)) / np.log(TOLERANCE), 0, 1)), "integrating")
            if left <= TOLERANCE:
                break
            step = self._cycle(0, residual)
            turned = (_dot(step, residual) - _dot(step, before)) / scale
            direction = step + np.float32(turned) * direction
            image = level.graph.times(direction, level.diagonal)
            scale, size = _dot(step, residual), _dot(direction, image)
            if scale <= 0 or size <= 0:  # only rounding errors remain
                break
            length = np.float32(_dot(direction, residual) / size)
            before = residual
            residual = residual - length * image
            heights += length * direction
        else:
            log.warning("the solution has not converged: %d iterations were too few", MAX_STEPS)
        return heights

    def _cycle(self, number: int, residual: F32) -> F32:
        """One V-cycle from zero: smoothing, correction from the coarser level, smoothing."""
        level = self.levels[number]
        if level.parent is None and self.inverse is not None:
            return (self.inverse @ residual).astype(np.float32)
        damped: F32 = np.divide(np.float32(DAMPING), np.maximum(level.diagonal, np.float32(1e-12)))
        heights: F32 = damped * residual
        if level.parent is not None:
            coarse = self.levels[number + 1].graph
            rest = residual - level.graph.times(heights, level.diagonal)
            summed = np.bincount(level.parent, rest, len(coarse.islands)).astype(np.float32)
            heights += self._cycle(number + 1, summed)[level.parent]
        heights += damped * (residual - level.graph.times(heights, level.diagonal))
        return heights


@dataclass(frozen=True)
class _Level:
    """One level of the multigrid solver."""

    graph: Graph
    """The connections on this level."""
    diagonal: F32
    """(N,). The diagonal of the graph's matrix."""
    parent: I64 | None
    """(N,). Each unknown's index on the coarser level; None on the coarsest."""


def _parents(graph: Graph) -> I64:
    """(N,) the coarse unknown of each: one per island and 2 x 2 cells. If every island is a single unknown, those that
    share most of a seam are merged."""
    cells = graph.cells.astype(np.int64) // 2
    if not (graph.neighbours == np.arange(len(cells))).all():
        width = int(cells[:, 1].max()) + 1
        place = cells[:, 0] * width + cells[:, 1]
        return _numbered(place * (int(graph.islands.max()) + 1) + graph.islands)
    best = np.arange(len(cells))
    order = np.argsort(graph.tie_weights, kind="stable")
    for one, other in (graph.ties[order].T, graph.ties[order, ::-1].T):
        best[one] = other  # the last write remains, which is the strongest
    return _numbered(connected(len(cells), np.arange(len(cells)), best))


def _numbered(labels: I64) -> I64:
    """(N,) the labels' ranks, from 0 without gaps."""
    return np.unique(labels, return_inverse=True)[1].reshape(-1)


def _coarser(graph: Graph, parent: I64) -> Graph:
    count = int(parent.max()) + 1
    cells, islands = np.empty((count, 2), np.int32), np.empty(count, np.int32)
    cells[parent], islands[parent] = graph.cells // 2, graph.islands
    neighbours = np.repeat(np.arange(count, dtype=np.int32)[None], 4, axis=0)
    weights = np.zeros((4, count), np.float32)
    for side in range(4):
        beyond = parent[graph.neighbours[side]]
        leaves = beyond != parent
        neighbours[side, parent[leaves]] = beyond[leaves]
        # Twice as many links cross to a neighbour twice as far away: half of their sum is the Laplacian again.
        weights[side] = np.bincount(parent[leaves], graph.weights[side, leaves], count) / 2
    ties, weight = _merged(np.sort(parent[graph.ties], axis=1), graph.tie_weights, count)
    hold = np.bincount(parent, graph.hold, count).astype(np.float32)
    return Graph(cells, islands, neighbours, weights, ties, weight, hold)


def _merged(ties: I64, weights: F32, count: int) -> tuple[I32, F32]:
    """Merge ties between the same two unknowns, and drop those from one to itself."""
    distinct = ties[:, 0] != ties[:, 1]
    keys, which = np.unique(ties[distinct, 0] * count + ties[distinct, 1], return_inverse=True)
    summed = np.bincount(which.reshape(-1), weights[distinct], len(keys)).astype(np.float32)
    return np.stack(np.divmod(keys, count), axis=1).astype(np.int32), summed


def _pseudo_inverse(graph: Graph) -> F64:
    """(N, N) the pseudo-inverse of the matrix, which gives parts without hold a mean of 0."""
    count = len(graph.islands)
    matrix = np.diag(graph.diagonal().astype(np.float64))
    for neighbour, weight in zip(graph.neighbours, graph.weights, strict=True):
        np.subtract.at(matrix, (np.arange(count), neighbour), weight)
    one, other = graph.ties.T
    np.subtract.at(matrix, (one, other), graph.tie_weights)
    np.subtract.at(matrix, (other, one), graph.tie_weights)
    return np.linalg.pinv(matrix, rcond=1e-6, hermitian=True).astype(np.float64, copy=False)


def _dot(one: F32, other: F32) -> float:
    return float(np.einsum("i,i->", one, other, dtype=np.float64))
