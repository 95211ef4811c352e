"""The bilateral method: a surface that breaks where one thing stands before another."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.heights.fast import fast
from mpsnet_core.heights.gradients import LEAST_FACING, Gradients
from mpsnet_core.heights.multigrid import Links, sums_of_blocks
from mpsnet_core.heights.poisson import solved
from mpsnet_core.progress import Progress, part, silent

# How sharply a pixel decides for one of its neighbours; the paper's value, for changes in pixels.
SHARPNESS = np.float32(2)
# What a neighbour counts at least: a part that is cut off all around stays where least squares put it.
LEAST = np.float32(1e-5)
# The longest side of a picture that is begun without a smaller one.
SMALL = 256
# Passes, on the picture and on each smaller one; iterations of the solver in each.
PASSES, ITERATIONS = 12, 6
# The share of a picture's work that is done before its own passes.
STARTED = 0.25


def bilateral(wanted: Gradients, progress: Progress = silent) -> NDArray[np.float32]:
    """(H, W) depth, in the unit of :class:`Gradients`, by Cao, Santo, Okura and Matsushita, "Bilateral Normal
    Integration", 2022.

    The surface is taken to go on from each pixel to at least one of its two neighbours in a row, and in a column. Each
    pixel's equation is asked of either one, weighted by a sigmoid of which of the two changes is the smaller, and these
    weights and the depth are found in turns. The paper takes up to a hundred turns, with a solver from scratch in each.
    Here a picture of half the size is done first, so that wide parts are in their places, the smallest one begins at
    what :func:`fast` gives, which knows where loops do not close, and each turn makes a few multigrid iterations from
    where the one before ended.
    """
    before = part(progress, 0.0, STARTED, "finding depth's edges")
    if max(wanted.mask.shape) <= SMALL:
        depth = fast(wanted, before)
    else:
        smaller = _halved(wanted)
        depth = _doubled(bilateral(smaller, before), smaller, wanted.mask)
    for number in range(PASSES):
        done, all_done = (STARTED + (1 - STARTED) * count / PASSES for count in (number, number + 1))
        told = part(progress, done, all_done, "finding depth's edges")
        weights, pulls = chosen_sides(wanted, depth)
        depth = solved(weights, pulls, depth, most=ITERATIONS, progress=told)
    return depth


def _halved(wanted: Gradients) -> Gradients:
    """The equations of a picture of half the size: the means over blocks of 2 x 2 pixels."""
    count = sums_of_blocks(wanted.mask.astype(np.float32))
    mask = count > 0
    np.maximum(count, 1, out=count)
    facing, right, down = (sums_of_blocks(values) / count for values in (wanted.facing, wanted.right, wanted.down))
    return Gradients(facing, right, down, mask)


def _doubled(depth: NDArray[np.float32], smaller: Gradients, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Depth for all pixels of the mask from that of their blocks, each of which goes on as it slopes."""
    doubled = np.zeros(mask.shape, np.float32)
    facing = np.maximum(smaller.facing, LEAST_FACING)
    right, down = smaller.right / facing, smaller.down / facing
    for row, column in np.ndindex(2, 2):
        pixels = doubled[row::2, column::2]
        blocks = 2 * depth + (column - np.float32(0.5)) * right + (row - np.float32(0.5)) * down
        pixels[:] = blocks[: pixels.shape[0], : pixels.shape[1]]
    doubled[~mask] = 0
    return doubled


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
