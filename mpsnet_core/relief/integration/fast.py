"""The fast method: least squares over all pixels, a surface without breaks."""

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.integration.gradients import Gradients
from mpsnet_core.relief.integration.multigrid import Links
from mpsnet_core.relief.integration.poisson import right_side, solve_poisson

# The changes along the four links of a loop of pixels sum to 0 on a continuous surface. If the sum (curl) is this many
# pixels, there is a depth discontinuity, and the weight of the loop's links is halved; it falls off quadratically.
LOOSE = np.float32(0.03)


def fast(wanted: Gradients, progress: Progress = silent) -> F32:
    """(H, W) depth, in the unit of :class:`Gradients`, by Poisson's equation.

    The change over a link is the mean of those that its two pixels require, weighted by the square of their `facing`.
    Links around loops that do not close have less weight, which keeps inconsistencies local (weights from the curl, as
    in Agrawal, Raskar and Chellappa, "What is the range of surface reconstructions from a gradient field?", 2006).
    """
    weights, weighted_changes = equations(wanted)
    sums = right_side(weighted_changes)
    del wanted, weighted_changes  # the solver takes much memory for a large photo
    return solve_poisson(weights, sums, np.zeros_like(sums), progress=progress)


def equations(wanted: Gradients) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times the weight."""
    facing, mask = wanted.facing, wanted.mask
    square = np.square(facing)
    weights = Links(_means(square.T, mask.T).T, _means(square, mask))
    del square
    weighted_changes = Links(_means((facing * wanted.right).T, mask.T).T, _means(facing * wanted.down, mask))
    trust = np.empty((len(weights.down), weights.right.shape[1]), np.float32)
    for rows in bands(len(trust)):
        trust[rows] = _loop_weights(*(_of_loops(links, rows) for links in (weights, weighted_changes)))
    for loops, *pair in (
        (trust, weights.right, weighted_changes.right),
        (trust.T, weights.down.T, weighted_changes.down.T),
    ):
        factors = np.ones_like(pair[0])
        factors[:-1] = loops
        np.minimum(factors[1:], loops, out=factors[1:])
        for links in pair:
            links *= factors
    return weights, weighted_changes


def _means(values: F32, mask: Bools) -> F32:
    """(N - 1, M) the mean of both pixels' values (N, M) for every link along the first axis; 0 if one is outside."""
    means = values[1:] + values[:-1]
    means *= np.float32(0.5)
    means[~(mask[1:] & mask[:-1])] = 0
    return means


def _of_loops(links: Links, rows: slice) -> Links:
    """The links of some rows of loops, each of which is between two rows of pixels."""
    return Links(links.right[rows.start : rows.stop + 1], links.down[rows])


def _loop_weights(weights: Links, weighted_changes: Links) -> F32:
    """(H - 1, W - 1) factor from 0 to 1 of each loop of four links, by how far it is from closing.

    A link gets the lower one of its two loops.
    """
    right, down = _changes(weights.right, weighted_changes.right), _changes(weights.down, weighted_changes.down)
    loose = right[:-1] + down[:, 1:]
    loose -= right[1:]
    loose -= down[:, :-1]
    # A loop that the mask interrupts gives no information.
    for side in (weights.right[:-1], weights.right[1:], weights.down[:, :-1], weights.down[:, 1:]):
        loose[side == 0] = 0
    loose *= 1 / LOOSE
    loose *= loose
    loose += 1
    return np.reciprocal(loose, out=loose)


def _changes(weight: F32, weighted_change: F32) -> F32:
    return np.divide(weighted_change, weight, out=np.zeros_like(weighted_change), where=weight > 0)
