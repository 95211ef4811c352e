"""The bilateral method: a surface with breaks at depth discontinuities."""

import numpy as np

from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.integration.fast import equations, fast
from mpsnet_core.relief.integration.gradients import MIN_FACING, Gradients
from mpsnet_core.relief.integration.multigrid import Links, restrict
from mpsnet_core.relief.integration.poisson import relax_locally, right_side, solve_poisson

# Sharpness of a pixel's choice between its two neighbours (k in the paper, with its value), for changes in pixels.
SHARPNESS = np.float32(2)
# Least weight of a neighbour: a part that is cut off all around stays where least squares put it.
MIN_WEIGHT = np.float32(1e-5)
# Residual of a pixel's equation, in pixels times `facing`, on its chosen side, at which its weight is halved. The first
# two are for the first and last pass at the coarsest level, because early cuts are seldom undone. The third is for all
# passes at finer levels, where breaks are nearly in place.
FIRST_OFF, SMALL_OFF, OFF = 8.0, 2.0, 0.5
# The search for breaks around those of a coarser level: links below this fraction of their full weight are cut, the
# true break is at most this many pixels away, and this many steps relax the pixels in between.
CUT, BESIDE, SEARCHING = np.float32(0.1), 2, 24
# In this search, the difference of the gradients of a link's two pixels, times `facing`, at which its weight is halved.
APART = np.float32(0.1)
# The coarsest level has at most this many pixels on its longer side.
SMALL = 200
# Passes at the coarsest level, where most changes happen, and at each finer one; solver iterations per pass.
FIRST_PASSES, PASSES, ITERATIONS = 24, 12, 6
# The fraction of a level's progress that its initial depth takes.
STARTED = 0.25


def bilateral(wanted: Gradients, progress: Progress = silent) -> F32:
    """(H, W) depth, in the unit of :class:`Gradients`, by Cao, Santo, Okura and Matsushita, "Bilateral Normal
    Integration", 2022.

    The surface is assumed to be continuous from each pixel to at least one of its two neighbours in its row, and in its
    column. Each pixel's equation applies to both, weighted by a sigmoid of the difference of the two squared changes:
    the smaller change gets the larger weight. Weights and depth are updated alternately.

    The paper takes up to a hundred such passes, each with a solve from scratch. Here the work goes from coarse to fine:
    a half-size level first positions large parts, the coarsest one starts from :func:`fast`, which detects loops that
    do not close, and each pass continues with a few multigrid iterations. A coarser level locates breaks only to its
    own pixels; see :func:`_searched`.

    Unlike in the paper, the weight of a pixel whose equation holds on neither side is reduced, more from pass to pass
    at the coarsest level (graduated non-convexity: Blake and Zisserman, "Visual Reconstruction", 1987). Otherwise false
    breaks across thin connections would persist, and straight ones would grow from the ends of true breaks.
    """
    before = part(progress, 0.0, STARTED, "finding depth's edges")
    if max(wanted.mask.shape) <= SMALL:
        depth, offs = fast(wanted, before), np.geomspace(FIRST_OFF, SMALL_OFF, FIRST_PASSES)
    else:
        smaller = _halved(wanted)
        depth, offs = (
            _searched(wanted, _doubled(bilateral(smaller, before), smaller, wanted.mask)),
            np.full(PASSES, OFF),
        )
    for number, off in enumerate(offs):
        done, all_done = (STARTED + (1 - STARTED) * count / len(offs) for count in (number, number + 1))
        step = part(progress, done, all_done, "finding depth's edges")
        weights, weighted_changes = chosen_sides(wanted, depth, off)
        sums = right_side(weighted_changes)
        depth = solve_poisson(weights, sums, depth, max_iterations=ITERATIONS, progress=step)
    return depth


def _halved(wanted: Gradients) -> Gradients:
    """The equations of the half-size level: means over blocks of 2 x 2 pixels."""
    count = restrict(wanted.mask.astype(np.float32))
    mask = count > 0
    np.maximum(count, 1, out=count)
    facing, right, down = (restrict(values) / count for values in (wanted.facing, wanted.right, wanted.down))
    return Gradients(facing, right, down, mask)


def _doubled(depth: F32, smaller: Gradients, mask: Bools) -> F32:
    """Depth of all pixels of the mask, from that of their 2 x 2 blocks and the blocks' gradients."""
    doubled = np.zeros(mask.shape, np.float32)
    facing = np.maximum(smaller.facing, MIN_FACING)
    right, down = smaller.right / facing, smaller.down / facing
    for row, column in np.ndindex(2, 2):
        pixels = doubled[row::2, column::2]
        blocks = 2 * depth + (column - np.float32(0.5)) * right + (row - np.float32(0.5)) * down
        pixels[:] = blocks[: pixels.shape[0], : pixels.shape[1]]
    doubled[~mask] = 0
    return doubled


def _searched(wanted: Gradients, depth: F32) -> F32:
    """Depth in which the pixels next to each break belong to neither side, so that the break can move.

    After doubling, breaks are staircases of two pixels. A pixel on the wrong side would stay there: it is continuous
    with its neighbours on that side, and its link to the right side is cut. With every doubling the stairs would grow.
    So these pixels are relaxed between the surfaces on both sides, which are fixed, with most of the change where
    neighbours require different gradients or loops do not close. The passes that follow decide anew.
    """
    beside = dilated(_breaks(wanted, chosen_sides(wanted, depth)[0]), BESIDE - 1)
    weights, weighted_changes = equations(wanted)
    gradient_right, gradient_down = (
        np.divide(values, wanted.facing, out=np.zeros_like(values), where=wanted.mask)
        for values in (wanted.right, wanted.down)
    )
    alike = _agreement(gradient_right.T, wanted.facing.T).T, _agreement(gradient_down, wanted.facing)
    for links in (weights, weighted_changes):
        links.right[:] *= alike[0]
        links.down[:] *= alike[1]
    return relax_locally(weights, weighted_changes, depth, beside, SEARCHING)


def _breaks(wanted: Gradients, weights: Links) -> Bools:
    """(H, W) the pixels at both ends of the links that are cut."""
    mask, square = wanted.mask, np.square(wanted.facing)
    broken = np.zeros_like(mask)
    for links, one, other in (
        (weights.right, np.s_[:, :-1], np.s_[:, 1:]),
        (weights.down, np.s_[:-1, :], np.s_[1:, :]),
    ):
        cut = (links < CUT * (square[one] + square[other])) & mask[one] & mask[other]
        broken[one] |= cut
        broken[other] |= cut
    return broken


def _agreement(gradient: F32, facing: F32) -> F32:
    """(N - 1, M) agreement, from 0 to 1, of the pixels (N, M) at both ends of links along the first axis."""
    apart = (gradient[1:] - gradient[:-1]) * np.minimum(facing[1:], facing[:-1])
    return np.reciprocal(1 + np.square(apart / APART))


def chosen_sides(wanted: Gradients, depth: F32, off: float = OFF) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times the weight, given the current depth.

    off: residual of a pixel's equation, in pixels times `facing`, at which its weight is halved.
    """
    height, width = depth.shape
    weights = Links(np.zeros((height, width - 1), np.float32), np.zeros((height - 1, width), np.float32))
    weighted_changes = Links(np.zeros_like(weights.right), np.zeros_like(weights.down))
    for rows in bands(height):
        weight, weighted_change = _along(
            depth[rows].T, wanted.facing[rows].T, wanted.right[rows].T, wanted.mask[rows].T, off
        )
        weights.right[rows], weighted_changes.right[rows] = weight.T, weighted_change.T
        # Both pixels of a link compare it with the change on their other side: one more row above and below.
        top = max(rows.start - 1, 0)
        near = slice(top, rows.stop + 2)
        weight, weighted_change = _along(depth[near], wanted.facing[near], wanted.down[near], wanted.mask[near], off)
        links = slice(rows.start, min(rows.stop, height - 1))
        weights.down[links], weighted_changes.down[links] = (
            found[rows.start - top : links.stop - top] for found in (weight, weighted_change)
        )
    return weights, weighted_changes


def _along(depth: F32, facing: F32, wanted: F32, mask: Bools, off: float) -> tuple[F32, F32]:
    """Weights and weighted changes, each (N - 1, M), of the links along the first axis of (N, M) pixels."""
    linked = mask[1:] & mask[:-1]
    change = (depth[1:] - depth[:-1]) * linked
    # By how much the squared change behind each pixel exceeds that ahead; 0 where there is no neighbour.
    steeper = np.zeros_like(depth)
    steeper[1:] = np.square(facing[1:] * change)
    steeper[:-1] -= np.square(facing[:-1] * change)
    # The sigmoid by tanh, which does not overflow.
    ahead = np.tanh(steeper * (SHARPNESS / 2)) * np.float32(0.5) + np.float32(0.5)
    first = ahead[:-1] / (1 + np.square((facing[:-1] * change - wanted[:-1]) / np.float32(off)))
    second = (1 - ahead[1:]) / (1 + np.square((facing[1:] * change - wanted[1:]) / np.float32(off)))
    counts = np.maximum(first, MIN_WEIGHT) * facing[:-1], np.maximum(second, MIN_WEIGHT) * facing[1:]
    weight = (counts[0] * facing[:-1] + counts[1] * facing[1:]) * linked
    weighted_change = (counts[0] * wanted[:-1] + counts[1] * wanted[1:]) * linked
    return weight, weighted_change
