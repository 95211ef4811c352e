"""The bilateral method: a surface that breaks where one thing stands before another."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.integration.fast import equations, fast
from mpsnet_core.relief.integration.gradients import LEAST_FACING, Gradients
from mpsnet_core.relief.integration.multigrid import Links, sums_of_blocks
from mpsnet_core.relief.integration.poisson import relaxed, solved

# How sharply a pixel decides for one of its neighbours; the paper's value, for changes in pixels.
SHARPNESS = np.float32(2)
# What a neighbour counts at least: a part that is cut off all around stays where least squares put it.
LEAST = np.float32(1e-5)
# A pixel's equation that is off by this many pixels, times `facing`, on the side that it decided for counts half. The
# first two are the first and the last pass's on the smallest picture, for what is cut early is seldom joined again; the
# third is that of all passes on larger ones, for breaks are about where they belong by then.
FIRST_OFF, SMALL_OFF, OFF = 8.0, 2.0, 0.5
# Of the search for breaks around those of a smaller picture: a link below this share of its full weight is cut, the
# true break is so many pixels from there at most, and so many steps fit these pixels in with what is around them.
CUT, BESIDE, SEARCHING = np.float32(0.1), 2, 24
# In it a link counts half where the changes that its two pixels require differ by so many pixels, times `facing`.
APART = np.float32(0.1)
# The longest side of a picture that is begun without a smaller one.
SMALL = 200
# Passes on the smallest picture, which has the longest way to go, and on each larger one; iterations of the solver.
FIRST_PASSES, PASSES, ITERATIONS = 24, 12, 6
# The share of a picture's work that is done before its own passes.
STARTED = 0.25


def bilateral(wanted: Gradients, progress: Progress = silent) -> NDArray[np.float32]:
    """(H, W) depth, in the unit of :class:`Gradients`, by Cao, Santo, Okura and Matsushita, "Bilateral Normal
    Integration", 2022.

    The surface is taken to go on from each pixel to at least one of its two neighbours in a row, and in a column. Each
    pixel's equation applies to either one, weighted by a sigmoid of which of the two changes is the smaller, and these
    weights and the depth are found in turns. The paper takes up to a hundred turns, with a solver from scratch in each.
    Here a picture of half the size is done first, so that wide parts are in their places, the smallest one begins at
    what :func:`fast` returns, which knows where loops do not close, and each turn makes a few multigrid iterations from
    where the one before ended. A smaller picture knows where breaks are to its own pixel only; see :func:`_searched`.
    Other than in the paper, a pixel whose equation neither side fulfils counts less, and ever less from pass to pass on
    the smallest picture (Blake and Zisserman's "Visual Reconstruction", 1987, calls it graduated non-convexity): else
    false breaks across what hangs together by little would stay, and straight ones grow out of the ends of true ones.
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
        weights, pulls = chosen_sides(wanted, depth, off)
        depth = solved(weights, pulls, depth, most=ITERATIONS, progress=step)
    return depth


def _halved(wanted: Gradients) -> Gradients:
    """The equations of a picture of half the size: the means over blocks of 2 x 2 pixels."""
    count = sums_of_blocks(wanted.mask.astype(np.float32))
    mask = count > 0
    np.maximum(count, 1, out=count)
    facing, right, down = (sums_of_blocks(values) / count for values in (wanted.facing, wanted.right, wanted.down))
    return Gradients(facing, right, down, mask)


def _doubled(depth: NDArray[np.float32], smaller: Gradients, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Depth for all pixels of the mask from that of their blocks, each of which goes on at its gradient."""
    doubled = np.zeros(mask.shape, np.float32)
    facing = np.maximum(smaller.facing, LEAST_FACING)
    right, down = smaller.right / facing, smaller.down / facing
    for row, column in np.ndindex(2, 2):
        pixels = doubled[row::2, column::2]
        blocks = 2 * depth + (column - np.float32(0.5)) * right + (row - np.float32(0.5)) * down
        pixels[:] = blocks[: pixels.shape[0], : pixels.shape[1]]
    doubled[~mask] = 0
    return doubled


def _searched(wanted: Gradients, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth of which the few pixels beside each break have left either side.

    After doubling, breaks run in steps of two pixels, and a pixel on the wrong side would stay there: it goes on as its
    neighbours on that side do, and its link to the right side is cut. With every doubling the steps would grow. So
    these pixels are laid between the surfaces on both sides, which stay, with most of the change where two neighbours
    require different gradients or loops do not close; the passes that follow decide anew.
    """
    beside = dilated(_breaks(wanted, chosen_sides(wanted, depth)[0]), BESIDE - 1)
    weights, pulls = equations(wanted)
    gradient_right, gradient_down = (
        np.divide(values, wanted.facing, out=np.zeros_like(values), where=wanted.mask)
        for values in (wanted.right, wanted.down)
    )
    alike = _alike(gradient_right.T, wanted.facing.T).T, _alike(gradient_down, wanted.facing)
    for links in (weights, pulls):
        links.right[:] *= alike[0]
        links.down[:] *= alike[1]
    return relaxed(weights, pulls, depth, beside, SEARCHING)


def _breaks(wanted: Gradients, weights: Links) -> NDArray[np.bool_]:
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


def _alike(gradient: NDArray[np.float32], facing: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N - 1, M) 0 to 1: how well the pixels (N, M) at both ends of links along the first axis agree."""
    apart = (gradient[1:] - gradient[:-1]) * np.minimum(facing[1:], facing[:-1])
    alike: NDArray[np.float32] = np.reciprocal(1 + np.square(apart / APART))
    return alike


def chosen_sides(wanted: Gradients, depth: NDArray[np.float32], off: float = OFF) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times that, as the depth found so far decides.

    off: by how many pixels, times `facing`, a pixel's equation is off that counts half.
    """
    height, width = depth.shape
    weights = Links(np.zeros((height, width - 1), np.float32), np.zeros((height - 1, width), np.float32))
    pulls = Links(np.zeros_like(weights.right), np.zeros_like(weights.down))
    for rows in bands(height):
        weight, pull = _along(depth[rows].T, wanted.facing[rows].T, wanted.right[rows].T, wanted.mask[rows].T, off)
        weights.right[rows], pulls.right[rows] = weight.T, pull.T
        # A link's two pixels compare it with the change on their other side: a row more, above and below.
        top = max(rows.start - 1, 0)
        near = slice(top, rows.stop + 2)
        weight, pull = _along(depth[near], wanted.facing[near], wanted.down[near], wanted.mask[near], off)
        links = slice(rows.start, min(rows.stop, height - 1))
        weights.down[links], pulls.down[links] = (
            found[rows.start - top : links.stop - top] for found in (weight, pull)
        )
    return weights, pulls


def _along(
    depth: NDArray[np.float32],
    facing: NDArray[np.float32],
    wanted: NDArray[np.float32],
    mask: NDArray[np.bool_],
    off: float,
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
    first = ahead[:-1] / (1 + np.square((facing[:-1] * change - wanted[:-1]) / np.float32(off)))
    second = (1 - ahead[1:]) / (1 + np.square((facing[1:] * change - wanted[1:]) / np.float32(off)))
    counts = np.maximum(first, LEAST) * facing[:-1], np.maximum(second, LEAST) * facing[1:]
    weight = (counts[0] * facing[:-1] + counts[1] * facing[1:]) * linked
    pull = (counts[0] * wanted[:-1] + counts[1] * wanted[1:]) * linked
    return weight, pull
