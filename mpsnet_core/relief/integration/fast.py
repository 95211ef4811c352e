"""The fast method: least squares over all pixels, a surface without breaks."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.integration.gradients import Gradients
from mpsnet_core.relief.integration.multigrid import Links
from mpsnet_core.relief.integration.poisson import solve_poisson

# The changes along the four links of a loop of pixels sum to 0 on a continuous surface. If the sum (curl) is this many
# pixels, there is a depth discontinuity, and the weight of the loop's links is halved; it falls off quadratically.
LOOSE = np.float32(0.03)


def fast(wanted: Gradients, progress: Progress = silent) -> NDArray[np.float32]:
    """(H, W) depth, in the unit of :class:`Gradients`, by Poisson's equation.

    The change over a link is the mean of those that its two pixels require, weighted by the square of their `facing`.
    Links around loops that do not close have less weight, which keeps inconsistencies local (weights from the curl, as
    in Agrawal, Raskar and Chellappa, "What is the range of surface reconstructions from a gradient field?", 2006).
    """
    return solve_poisson(*equations(wanted), np.zeros_like(wanted.facing), progress=progress)


def equations(wanted: Gradients) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times the weight."""
    facing = wanted.facing
    weights = _mean_links(facing * facing, facing * facing, wanted.mask)
    weighted_changes = _mean_links(facing * wanted.right, facing * wanted.down, wanted.mask)
    trust = _curl_weights(weights, weighted_changes)
    for links in (weights, weighted_changes):
        np.multiply(links.right, trust.right, out=links.right)
        np.multiply(links.down, trust.down, out=links.down)
    return weights, weighted_changes


def _mean_links(right: NDArray[np.float32], down: NDArray[np.float32], mask: NDArray[np.bool_]) -> Links:
    """The mean of both pixels' values, for every link between two pixels of the mask; 0 for others."""
    half = np.float32(0.5)
    across = (right[:, 1:] + right[:, :-1]) * half
    along = (down[1:] + down[:-1]) * half
    across[~(mask[:, 1:] & mask[:, :-1])] = 0
    along[~(mask[1:] & mask[:-1])] = 0
    return Links(across, along)


def _curl_weights(weights: Links, weighted_changes: Links) -> Links:
    """Factors from 0 to 1 on the links, by the one of a link's two loops that closes worse."""
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
    trust = np.reciprocal(loose, out=loose)
    right.fill(1)
    down.fill(1)
    for links, first, second in ((right, np.s_[:-1], np.s_[1:]), (down, np.s_[:, :-1], np.s_[:, 1:])):
        links[first] = trust
        np.minimum(links[second], trust, out=links[second])
    return Links(right, down)


def _changes(weight: NDArray[np.float32], weighted_change: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.divide(weighted_change, weight, out=np.zeros_like(weighted_change), where=weight > 0)
