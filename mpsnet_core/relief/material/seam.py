"""A picture made to meet itself: overlapping borders joined along the line where they differ least."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import box_sums

# Pixels over which one border gives way to the other, on either side of the cut.
FEATHER = 2
# Rows that a cut needs: one to go along, and the feather on either side.
LEAST_JOINED = 2 * FEATHER + 1
# What is coarser than this share of the overlap is not cut but faded over all of it: a cut would show it as an edge.
FADED = 8


def wrapped(patch: NDArray[np.float32], overlap: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A picture (H, W, C) that can be laid beside itself, from a larger one, and where it was cut.

    patch: (H + overlap[0], W + overlap[1], C): the overlap's rows and columns are, or nearly are, those that the
        picture begins with. All channels are cut alike, where they differ least in all.

    Returns the picture and (H, W) bool, True on the cuts. At its border it is what the patch is there, unbroken.
    """
    across, cut = _wrapped_rows(patch.swapaxes(0, 1), overlap[1], closed=False)
    done, second_cut = _wrapped_rows(across.swapaxes(0, 1), overlap[0], closed=True)
    # The first cut as far as the second keeps it; the last rows are what the overlap showed.
    cut = cut.swapaxes(0, 1)[: len(done)]
    return done, cut | second_cut


def _wrapped_rows(
    patch: NDArray[np.float32], overlap: int, *, closed: bool
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The patch's first rows, so that they follow on its last but the overlap; and where it was cut.

    closed: the patch's last column is followed by its first, so the cut has to meet itself there too.
    """
    first, second = patch[:overlap], patch[len(patch) - overlap :]
    apart = first - second
    coarse = _coarse(apart, max(1, overlap // FADED), closed)
    line = minimum_cut(np.square(apart - coarse).sum(axis=-1), closed=closed)
    rows = np.arange(overlap)[:, None]
    share = _eased((rows - line + FEATHER) / (2 * FEATHER))[..., None]
    faded = _eased((rows[..., None] + 0.5) / overlap)
    done = patch[: len(patch) - overlap].copy()
    done[:overlap] = second + share * (apart - coarse) + faded * coarse
    cut = np.zeros(done.shape[:2], bool)
    cut[:overlap] = rows == line
    return done, cut


def minimum_cut(cost: NDArray[np.floating[Any]], *, closed: bool) -> NDArray[np.int64]:
    """(W,) the row in each column of the line across `cost` (H, W) that costs least (Efros and Freeman 2001).

    From one column to the next the line moves by a row at most. It keeps FEATHER rows from the upper and lower edge.
    closed: it ends beside where it starts. Then it is the best of those through the place where the open line costs
    least.
    """
    inner = cost[FEATHER : len(cost) - FEATHER]
    line = _open_cut(inner, None)
    if closed:
        column = int(np.argmin(inner[line, np.arange(len(line))]))
        line = np.roll(_open_cut(np.roll(inner, -column, axis=1), int(line[column])), column)
    return line + FEATHER


def _open_cut(cost: NDArray[np.floating[Any]], through: int | None) -> NDArray[np.int64]:
    """The cheapest line by dynamic programming; one that starts in row `through` and ends beside it, where given."""
    height, width = cost.shape
    total = cost[:, 0].astype(np.float64)
    if through is not None:
        total[np.arange(height) != through] = np.inf
    came = np.zeros((width, height), np.int8)
    rows = np.arange(height)
    for column in range(1, width):
        padded = np.concatenate([[np.inf], total, [np.inf]])
        choices = np.stack([padded[1:-1], padded[:-2], padded[2:]])
        best = choices.argmin(axis=0)
        came[column] = np.array([0, -1, 1], np.int8)[best]
        total = choices[best, rows] + cost[:, column]
    if through is not None:
        total[np.abs(rows - through) > 1] = np.inf
    line = np.empty(width, np.int64)
    line[-1] = np.argmin(total)
    for column in range(width - 1, 0, -1):
        line[column - 1] = line[column] + came[column, line[column]]
    return line


def _coarse(apart: NDArray[np.float32], reach: int, closed: bool) -> NDArray[np.float32]:
    """What is coarser than `reach` pixels: two means over squares around each pixel, one of the other."""
    sides = (2 * reach, 2 * reach) if closed else (0, 0)
    padded = np.pad(apart, ((0, 0), sides, (0, 0)), mode="wrap")
    counts = box_sums(np.ones(padded.shape[:2]), reach)
    for channel in range(padded.shape[-1]):
        for _ in range(2):
            padded[..., channel] = box_sums(padded[..., channel], reach) / counts
    return padded[:, sides[0] : padded.shape[1] - sides[1]]


def _eased(share: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """0 up to 0 and 1 from 1 on, without a corner between."""
    share = np.clip(share, 0, 1)
    eased: NDArray[np.float32] = (share * share * (3 - 2 * share)).astype(np.float32)
    return eased


@dataclass(frozen=True)
class Seam:
    """How much more the surface turns where the tile was joined than elsewhere: 1 is no more.

    border: the angle between normals on either side of the tile's border, as a share of that between any two
        neighbours; the mean and the 95th percentile. cut: the same across the lines where it was cut and joined.
    """

    border: tuple[float, float]
    cut: tuple[float, float]


def measured_seam(normals: NDArray[np.float32], cut: NDArray[np.bool_]) -> Seam:
    """How visible the joins of a tile's normals (H, W, 3) are. cut: (H, W) where it was cut."""
    border, cuts, inner = [], [], []
    for axis in (0, 1):
        turned = np.linalg.norm(np.roll(normals, -1, axis) - normals, axis=-1)
        crossed = cut | np.roll(cut, -1, axis)
        last = np.zeros_like(cut)
        last[(-1,) if axis == 0 else (slice(None), -1)] = True
        border.append(turned[last])
        cuts.append(turned[crossed & ~last])
        inner.append(turned[~crossed & ~last])
    return Seam(_shares(border, inner), _shares(cuts, inner))


def _shares(steps: list[NDArray[np.float32]], inner: list[NDArray[np.float32]]) -> tuple[float, float]:
    these, those = np.concatenate(steps), np.concatenate(inner)
    if not len(these):
        return 1.0, 1.0
    low = 1e-6  # a flat surface has no steps at all
    mean = (float(these.mean()) + low) / (float(those.mean()) + low)
    return mean, (float(np.percentile(these, 95)) + low) / (float(np.percentile(those, 95)) + low)
