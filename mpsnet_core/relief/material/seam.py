"""Seamless tiles: overlapping borders of an image joined along the line where they differ least."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.arrays.types import F32, I64, Bools, Floats

# Pixels of cross-fade on either side of the cut.
FEATHER = 2
# Rows that a cut needs: its own, and the feather on either side.
MIN_JOINED = 2 * FEATHER + 1
# Differences coarser than the overlap divided by this are faded over all of it: a cut would show them as an edge.
FADED = 8


def make_seamless(patch: F32, overlap: tuple[int, int]) -> tuple[F32, Bools]:
    """A tile (H, W, C) that repeats without a seam, from a larger image, and the places of its cuts.

    patch: (H + overlap[0], W + overlap[1], C): the rows and columns of the overlap at its end are equal, or similar, to
        those at its beginning. All channels share one cut, where their total difference is smallest.

    Returns the tile and (H, W) bool, True on the cuts. The tile's own border has no cut: the patch continues across it.
    """
    across, cut = _make_rows_seamless(patch.swapaxes(0, 1), overlap[1], closed=False)
    done, second_cut = _make_rows_seamless(across.swapaxes(0, 1), overlap[0], closed=True)
    # Keep the first cut in the rows that remain; the last rows were the overlap.
    cut = cut.swapaxes(0, 1)[: len(done)]
    return done, cut | second_cut


def _make_rows_seamless(patch: F32, overlap: int, *, closed: bool) -> tuple[F32, Bools]:
    """The patch without its last `overlap` rows, blended so that its first row continues its last; and the cut.

    closed: the patch repeats along columns already, so the cut must meet itself there.
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


def minimum_cut(cost: Floats, *, closed: bool) -> I64:
    """(W,) the row in each column of the minimum-cost line across `cost` (H, W) (Efros and Freeman 2001).

    The line moves by at most one row per column, and stays FEATHER rows away from the upper and lower edge. closed: it
    ends next to its start. Then it is the best line through the cheapest point of the open one.
    """
    inner = cost[FEATHER : len(cost) - FEATHER]
    line = _open_cut(inner, None)
    if closed:
        column = int(np.argmin(inner[line, np.arange(len(line))]))
        line = np.roll(_open_cut(np.roll(inner, -column, axis=1), int(line[column])), column)
    return line + FEATHER


def _open_cut(cost: Floats, through: int | None) -> I64:
    """The cheapest line by dynamic programming. If `through` is given, it starts in that row and ends next to it."""
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


def _coarse(apart: F32, reach: int, closed: bool) -> F32:
    """The low frequencies, coarser than `reach` pixels: a box filter over squares, applied twice."""
    sides = (2 * reach, 2 * reach) if closed else (0, 0)
    padded = np.pad(apart, ((0, 0), sides, (0, 0)), mode="wrap")
    counts = box_sums(np.ones(padded.shape[:2]), reach)
    for channel in range(padded.shape[-1]):
        for _ in range(2):
            padded[..., channel] = box_sums(padded[..., channel], reach) / counts
    return padded[:, sides[0] : padded.shape[1] - sides[1]]


def _eased(share: Floats) -> F32:
    """Smoothstep from 0 to 1."""
    share = np.clip(share, 0, 1)
    return (share * share * (3 - 2 * share)).astype(np.float32)


@dataclass(frozen=True)
class Seam:
    """Visibility of a tile's joins: the change of normals across them, relative to elsewhere. 1 is invisible."""

    border: tuple[float, float]
    """Angle between normals on either side of the tile's border, divided by that between any two neighbours; the mean
    and the 95th percentile."""
    cut: tuple[float, float]
    """The same across the cuts."""


def measure_seam(normals: F32, cut: Bools) -> Seam:
    """Measure how visible the joins of a tile's normals (H, W, 3) are. cut: (H, W) where it was cut."""
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


def _shares(steps: list[F32], inner: list[F32]) -> tuple[float, float]:
    these, those = np.concatenate(steps), np.concatenate(inner)
    if not len(these):
        return 1.0, 1.0
    low = 1e-6  # a flat surface has no steps at all
    mean = (float(these.mean()) + low) / (float(those.mean()) + low)
    return mean, (float(np.percentile(these, 95)) + low) / (float(np.percentile(those, 95)) + low)
