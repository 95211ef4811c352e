"""Horizons: the highest elevation of the surface in every direction from a pixel, for ambient occlusion.

Directions are grouped into a few sectors. Each pixel of a 4 x 4 block uses another direction within them: together they
cover many directions at the cost of a few. Arrays here are laid out in *cells*, (4, 4, h, w): pixels at the same
position in their block are contiguous, and all of them use the same directions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import gcd, hypot
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64, Bools

T = TypeVar("T", bound=np.generic)

BLOCK = 4
# Rank of each pixel's direction within a sector (Bayer matrix): directions of neighbouring pixels are far apart.
TURNS = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
# Each sector surrounds a line in steps of up to this many pixels sideways and up.
FINENESS = 2
# Minimum number of samples per doubling of the distance: at a distance, stretches of pixels cover the same angle.
STRETCHES = 4
# Limit of a pixel's own gradient across a line (height by distance): a steep one, as at rims, says little about what is
# beside it.
STEEPEST = np.float32(1)
# Pixels per band: intermediate arrays stay in the CPU cache.
AT_ONCE = 1 << 15


@dataclass(frozen=True)
class Sector:
    """Directions around a line in the image."""

    step: I64
    """(2,) int64. Whole pixels to the right and up along the line."""
    angles: F64
    """(4, 4) float64. Direction of each pixel of a block in radians, from right towards up."""
    share: float
    """Fraction of all angles that the sector and its opposite cover."""

    def turned(self) -> "Sector":
        """The opposite sector."""
        return Sector(-self.step, self.angles + np.pi, self.share)

    def ways(self) -> F64:
        """(4, 4, 2) unit vectors of the directions, right and up."""
        return np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)


def sectors() -> list[Sector]:
    """The sectors of half of all directions. The others are opposite to them."""
    span = range(-FINENESS, FINENESS + 1)
    steps = sorted(
        ((x, y) for x in span for y in span if gcd(x, y) == 1 and (y > 0 or (y == 0 and x > 0))),
        key=lambda step: np.arctan2(step[1], step[0]),
    )
    angles = np.array([np.arctan2(y, x) for x, y in steps])
    around = np.concatenate([[angles[-1] - np.pi], angles, [np.pi]])
    ends = (around[1:] + around[:-1]) / 2
    inside = (TURNS + 0.5) / TURNS.size
    return [
        Sector(np.array(step), first + (last - first) * inside, float(last - first) / np.pi)
        for step, first, last in zip(steps, ends[:-1], ends[1:], strict=True)
    ]


def to_cells(values: NDArray[T]) -> NDArray[T]:
    """An image (H, W) in cells (4, 4, h, w), padded with 0 to whole blocks."""
    height, width = values.shape
    blocks = np.zeros((-(-height // BLOCK) * BLOCK, -(-width // BLOCK) * BLOCK), values.dtype)
    blocks[:height, :width] = values
    divided = blocks.reshape(len(blocks) // BLOCK, BLOCK, -1, BLOCK)
    return np.ascontiguousarray(divided.transpose(1, 3, 0, 2))


def from_cells(cells: F32, shape: tuple[int, ...]) -> F32:
    """The image (H, W) from cells, the inverse of :func:`to_cells`."""
    height, width = cells.shape[2:]
    return cells.transpose(2, 0, 3, 1).reshape(BLOCK * height, BLOCK * width)[: shape[0], : shape[1]]


def cell_bands(cells: F32) -> list[slice]:
    """Bands of rows in cells, whose intermediate arrays stay in the CPU cache."""
    return bands(cells.shape[2], max(1, AT_ONCE // cells.shape[3]))


@dataclass(frozen=True)
class OcclusionGrid:
    """The surface, in cells."""

    heights: F32
    """(4, 4, h, w) float32. Heights in any unit, 0 outside the mask."""
    mask: Bools
    """(4, 4, h, w) bool. Where the surface is."""
    slopes: Callable[[tuple[int, ...], slice], tuple[F32, F32]]
    """Gives, for some rows in one cell, the rise to the next pixel on the right and above by the surface's own
    gradient; computed when needed, because it takes much memory."""


def horizons(ground: OcclusionGrid, sector: Sector, reach: int) -> F32:
    """(4, 4, h, w) the highest gradient in each pixel's direction, per pixel of distance, up to `reach` pixels away.

    Minus infinity where there is no surface. With distance, longer stretches parallel to the sector's line are sampled,
    each at its highest pixel: an actual point of the surface, so no horizon is invented. Such a pixel lies a little
    beside the direction. It is corrected by the surface's gradient across, which is assumed to be that of the central
    pixel. This is exact on planes, and convex surfaces do not occlude themselves.
    """
    gradients = np.full_like(ground.heights, -np.inf)
    ways, length = sector.ways(), hypot(*sector.step)
    east, north = np.moveaxis(ways, -1, 0)
    # The length of a stretch's step along the direction, and its drift to the left per pixel along.
    forth = ways @ sector.step
    leaning = (east * sector.step[1] - north * sector.step[0]) / forth
    across = np.empty_like(gradients)
    for cell in np.ndindex(BLOCK, BLOCK):
        for rows in cell_bands(ground.heights):
            right, up = ground.slopes(cell, rows)
            left = np.float32(east[cell]) * up - np.float32(north[cell]) * right
            np.clip(left, -STEEPEST, STEEPEST, out=across[cell][rows])
    # For the stretch that starts at each pixel: height of its highest pixel, and the steps to it.
    highest, place, stretch = ground.heights.copy(), np.zeros(gradients.shape, np.uint16), 1
    highest[~ground.mask] = -np.inf
    away = 1.0
    while away <= reach:
        if away >= 2 * STRETCHES * stretch * length:
            _double(highest, place, stretch, sector.step)
            stretch *= 2
        offsets = np.rint(away * ways)
        along = (offsets * ways).sum(axis=-1)
        aside = east * offsets[..., 1] - north * offsets[..., 0] - leaning * along
        for cell in np.ndindex(BLOCK, BLOCK):
            ahead, step = _at(cell, offsets[cell])
            parts = ground.heights[cell], highest[ahead], across[cell], place[ahead] if stretch > 1 else None
            _raise_horizons(gradients[cell], parts, step, (float(along[cell]), float(forth[cell])), float(aside[cell]))
        # Advance one pixel at a time until a stretch is short enough for the distance.
        away += stretch * length if away >= STRETCHES * stretch * length else 1
    # The correction for the drift, which `_raise_horizons` leaves out because it is the same for all stretches.
    del highest, place
    across *= leaning[..., None, None].astype(np.float32)
    gradients -= across
    return gradients


def _at(cell: tuple[int, ...], offset: NDArray[np.number[Any]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The cell of the pixels at an offset (right, up), and the offset (right, down) within that cell."""
    row, column = cell[0] - int(offset[1]), cell[1] + int(offset[0])
    return (row % BLOCK, column % BLOCK), (column // BLOCK, row // BLOCK)


def _overlap(shape: tuple[int, ...], step: tuple[int, int]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of all pixels that have another pixel at the offset `step` (right, down), and of those others."""
    (height, width), (right, down) = shape, step
    own = slice(max(0, -down), max(0, height - max(0, down))), slice(max(0, -right), max(0, width - max(0, right)))
    ahead = slice(max(0, down), max(0, height + min(0, down))), slice(max(0, right), max(0, width + min(0, right)))
    return own, ahead


def _double(highest: F32, place: NDArray[np.uint16], stretch: int, step: I64) -> None:
    """Turn `highest` and `place` into those of stretches twice as long, in place.

    The cells that follow one another form rings: in each, only the first cell is copied, to which the last one leads.
    """
    waiting = set(np.ndindex(BLOCK, BLOCK))
    while waiting:
        first = cell = min(waiting)
        copied = highest[first].copy(), place[first].copy()
        while cell in waiting:
            waiting.remove(cell)
            cell_ahead, moved = _at(cell, stretch * step)
            own, others = _overlap(highest.shape[2:], moved)
            further, places = copied if cell_ahead == first else (highest[cell_ahead], place[cell_ahead])
            higher = further[others] > highest[cell][own]
            np.copyto(place[cell][own], places[others] + np.uint16(stretch), where=higher)
            np.copyto(highest[cell][own], further[others], where=higher)
            cell = cell_ahead


def _raise_horizons(
    gradients: F32,
    parts: tuple[F32, F32, F32, NDArray[np.uint16] | None],
    step: tuple[int, int],
    along: tuple[float, float],
    aside: float,
) -> None:
    """Raise the gradients (h, w) to those of one stretch, which starts at the offset `step` within its own cell.

    parts: heights, highest heights of the stretches, the gradient across, and the step to the highest pixel (None for
    stretches of one pixel). along: distance along the direction of a stretch's first pixel, and of each step. aside:
    distance to the left at which the stretch, extended backwards, passes the central pixel. The drift per step is the
    same for all stretches; the caller corrects it.
    """
    heights, highest, across, place = parts
    (own, columns), (ahead, columns_ahead) = _overlap(gradients.shape, step)
    height, width = own.stop - own.start, columns.stop - columns.start
    if height <= 0 or width <= 0:
        return
    for rows in bands(height, max(1, AT_ONCE // width)):
        own_part = slice(own.start + rows.start, own.start + rows.stop), columns
        ahead_part = slice(ahead.start + rows.start, ahead.start + rows.stop), columns_ahead
        rise = highest[ahead_part] - heights[own_part]
        scratch = across[own_part] * np.float32(aside)
        rise -= scratch
        if place is None:
            rise *= np.float32(1 / along[0])
        else:
            np.multiply(place[ahead_part], np.float32(along[1]), out=scratch)
            scratch += np.float32(along[0])
            rise /= scratch
        np.maximum(gradients[own_part], rise, out=gradients[own_part])
