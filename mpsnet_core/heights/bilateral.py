"""The bilateral method: a surface that breaks where one thing stands before another."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.heights.fast import fast
from mpsnet_core.heights.gradients import Gradients
from mpsnet_core.heights.multigrid import Links
from mpsnet_core.heights.poisson import solved
from mpsnet_core.progress import Progress, part, silent

# How sharply a pixel decides for one of its neighbours; the paper's value, for changes in pixels.
SHARPNESS = np.float32(2)
# What a neighbour counts at least: a part that is cut off all around stays where least squares put it.
LEAST = np.float32(1e-5)
# Passes, and iterations of the solver in each; how far the fast method's share of the progress goes.
PASSES, ITERATIONS, STARTED = 15, 6, 0.2


def bilateral(wanted: Gradients, progress: Progress = silent) -> NDArray[np.float32]:
    """(H, W) depth, in the unit of :class:`Gradients`, by Cao, Santo, Okura and Matsushita, "Bilateral Normal
    Integration", 2022.

    The surface is taken to go on from each pixel to at least one of its two neighbours in a row, and in a column. Each
    pixel's equation is asked of either one, weighted by a sigmoid of which of the two changes is the smaller
    (equations 9 to 13), and these weights and the depth are found in turns. In place of a hundred turns with a solver
    from scratch in each, the turns begin at what :func:`fast` gives, which knows where loops do not close, and each
    makes a few multigrid iterations from where the one before ended.
    """
    depth = fast(wanted, part(progress, 0.0, STARTED, "integrating"))
    for number in range(PASSES):
        ends = (STARTED + (1 - STARTED) * np.array([number, number + 1]) / PASSES).tolist()
        weights, pulls = chosen_sides(wanted, depth)
        depth = solved(weights, pulls, depth, most=ITERATIONS, progress=part(progress, *ends, "finding depth's edges"))
    return depth


def chosen_sides(wanted: Gradients, depth: NDArray[np.float32]) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times that, as the depth found so far decides."""
    height, width = depth.shape
    weights = Links(np.zeros((height, width - 1), np.float32), np.zeros((height - 1, width), np.float32))
    pulls = Links(np.zeros_like(weights.right), np.zeros_like(weights.down))
    for rows in bands(height):
        weight, pull = _along(depth[rows].T, wanted.facing[rows].T, wanted.right[rows].T, wanted.mask[rows].T)
        weights.right[rows], pulls.right[rows] = weight.T, pull.T
        # A link's two pixels ask what the change is on their other side: a row more, above and below.
        top = max(rows.start - 1, 0)
        near = slice(top, rows.stop + 2)
        weight, pull = _along(depth[near], wanted.facing[near], wanted.down[near], wanted.mask[near])
        links = slice(rows.start, min(rows.stop, height - 1))
        weights.down[links], pulls.down[links] = (
            found[rows.start - top : links.stop - top] for found in (weight, pull)
        )
    return weights, pulls


def _along(
    depth: NDArray[np.float32], facing: NDArray[np.float32], wanted: NDArray[np.float32], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Weights and pulls, each (N - 1, M), of the links along the first axis of (N, M) pixels."""
    linked = mask[1:] & mask[:-1]
    change = (depth[1:] - depth[:-1]) * linked
    # How much steeper it is behind each pixel than ahead; where there is no neighbour it counts as level.
    steeper = np.zeros_like(depth)
    steeper[1:] = np.square(facing[1:] * change)
    steeper[:-1] -= np.square(facing[:-1] * change)
    # tanh, which does not overflow, is the same curve.
    ahead = np.tanh(steeper * (SHARPNESS / 2)) * np.float32(0.5) + np.float32(0.5)
    counts = np.maximum(ahead, LEAST)[:-1] * facing[:-1], np.maximum(1 - ahead, LEAST)[1:] * facing[1:]
    weight = (counts[0] * facing[:-1] + counts[1] * facing[1:]) * linked
    pull = (counts[0] * wanted[:-1] + counts[1] * wanted[1:]) * linked
    return weight, pull
