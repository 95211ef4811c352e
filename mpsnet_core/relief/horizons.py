"""Horizons: how high the surface rises towards every side of a pixel.

There are a few sectors of directions, and each of 4 x 4 neighbouring pixels looks another way within them: together
they see many directions for the price of a few. So everything here is laid out in *cells*, (4, 4, h, w): pixels of the
same place in their block of 4 x 4 lie together, and all of them look the same way.
"""

from dataclasses import dataclass
from math import gcd, hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands

BLOCK = 4
# In which order the pixels of a block take the directions of a sector: neighbours look far apart (Bayer's matrix).
TURNS = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]])
# Each sector is around a line from pixel to pixel of up to so many to the side and up.
FINENESS = 2
# At least so many looks to each doubling of the distance: what is far counts by its angle.
STRETCHES = 4
# A pixel's own gradient aside of a line, in heights by distance, counts as no more than this: of steep ones, which rims
# are, next to nothing follows for what is beside them.
STEEPEST = np.float32(1)
# Pixels of a band: what is made of them on the way stays in the processor's own memory.
AT_ONCE = 1 << 15


@dataclass(frozen=True)
class Sector:
    """Directions about a line over the picture. step: (2,) whole pixels to the right and up along the line. angles:
    (4, 4) from the right towards up, of each pixel of a block. share: of all angles, the sector and its opposite.
    """

    step: NDArray[np.int64]
    angles: NDArray[np.float64]
    share: float

    def turned(self) -> "Sector":
        """The opposite one."""
        return Sector(-self.step, self.angles + np.pi, self.share)

    def ways(self) -> NDArray[np.float64]:
        """(4, 4, 2) unit vectors, to the right and up."""
        return np.stack([np.cos(self.angles), np.sin(self.angles)], axis=-1)


def sectors() -> list[Sector]:
    """Half of all directions; the others are opposite to them."""
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


def to_cells(values: NDArray[np.floating[Any]], outside: float = 0) -> NDArray[np.float32]:
    """(4, 4, h, w) of a picture (H, W), which is filled up with `outside` to whole blocks."""
    height, width = values.shape
    blocks = np.full((-(-height // BLOCK) * BLOCK, -(-width // BLOCK) * BLOCK), outside, np.float32)
    blocks[:height, :width] = values
    divided = blocks.reshape(len(blocks) // BLOCK, BLOCK, -1, BLOCK)
    return np.ascontiguousarray(divided.transpose(1, 3, 0, 2))


def from_cells(cells: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """(H, W) of :func:`to_cells`."""
    height, width = cells.shape[2:]
    return cells.transpose(2, 0, 3, 1).reshape(BLOCK * height, BLOCK * width)[: shape[0], : shape[1]]


@dataclass(frozen=True)
class Ground:
    """What is looked over, in cells; heights in any unit.

    heights: 0 outside the mask. seen: the same, minus infinity outside. right, up: by how much the surface's own
    gradient rises to the next pixel.
    """

    heights: NDArray[np.float32]
    seen: NDArray[np.float32]
    right: NDArray[np.float32]
    up: NDArray[np.float32]


def horizons(ground: Ground, sector: Sector, reach: int) -> NDArray[np.float32]:
    """(4, 4, h, w) the highest gradient along each pixel's way, per pixel of distance, up to `reach` pixels away; minus
    infinity where there is nothing.

    What is farther away is looked at in longer stretches, parallel to the sector's line, at the highest pixel of each:
    all are points of the surface, so that nothing is hidden by what is not there. Such a pixel lies a little aside of
    the way; the surface is taken to have the gradient there, across, that it has at the pixel that looks. So on planes
    this is exact, and on what bulges nothing is hidden.
    """
    gradients = np.full_like(ground.heights, -np.inf)
    ways, length = sector.ways(), hypot(*sector.step)
    east, north = np.moveaxis(ways, -1, 0)
    # How far a step of the stretches goes along the way, and how far to its left for each pixel along.
    forth = ways @ sector.step
    leaning = (east * sector.step[1] - north * sector.step[0]) / forth
    across = np.empty_like(gradients)
    for cell in np.ndindex(BLOCK, BLOCK):
        left = np.float32(east[cell]) * ground.up[cell] - np.float32(north[cell]) * ground.right[cell]
        np.clip(left, -STEEPEST, STEEPEST, out=across[cell])
    # Of the stretch that begins at each pixel: how high its highest pixel is, and how many steps on.
    highest, place, stretch = ground.seen, np.zeros_like(gradients), 1
    away = 1.0
    while away <= reach:
        if away >= 2 * STRETCHES * stretch * length:
            highest, place = _doubled(highest, place, stretch, sector.step)
            stretch *= 2
        offsets = np.rint(away * ways)
        along = (offsets * ways).sum(axis=-1)
        aside = east * offsets[..., 1] - north * offsets[..., 0] - leaning * along
        for cell in np.ndindex(BLOCK, BLOCK):
            ahead, step = _at(cell, offsets[cell])
            parts = ground.heights[cell], highest[ahead], across[cell], place[ahead] if stretch > 1 else None
            _look(gradients[cell], parts, step, (float(along[cell]), float(forth[cell])), float(aside[cell]))
        # One pixel at a time until the stretches fit in.
        away += stretch * length if away >= STRETCHES * stretch * length else 1
    # What every look has left out: see there.
    across *= leaning[..., None, None].astype(np.float32)
    gradients -= across
    return gradients


def _at(cell: tuple[int, ...], offset: NDArray[np.number[Any]]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Which cell the pixels lie in that are an offset (to the right, up) away, and how far on (right, down) there."""
    row, column = cell[0] - int(offset[1]), cell[1] + int(offset[0])
    return (row % BLOCK, column % BLOCK), (column // BLOCK, row // BLOCK)


def _overlap(shape: tuple[int, ...], step: tuple[int, int]) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of all pixels that have another one a step (to the right, down) away, and of those others."""
    (height, width), (right, down) = shape, step
    own = slice(max(0, -down), max(0, height - max(0, down))), slice(max(0, -right), max(0, width - max(0, right)))
    ahead = slice(max(0, down), max(0, height + min(0, down))), slice(max(0, right), max(0, width + min(0, right)))
    return own, ahead


def _doubled(
    highest: NDArray[np.float32], place: NDArray[np.float32], stretch: int, step: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The same of stretches twice as long."""
    both, places = highest.copy(), place.copy()
    for cell in np.ndindex(BLOCK, BLOCK):
        cell_ahead, moved = _at(cell, stretch * step)
        own, others = _overlap(highest.shape[2:], moved)
        further = highest[cell_ahead][others]
        higher = further > highest[cell][own]
        np.copyto(places[cell][own], place[cell_ahead][others] + np.float32(stretch), where=higher)
        np.copyto(both[cell][own], further, where=higher)
    return both, places


def _look(
    gradients: NDArray[np.float32],
    parts: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | None],
    step: tuple[int, int],
    along: tuple[float, float],
    aside: float,
) -> None:
    """Raise the gradients (h, w) to those of one stretch, which begins a step away in its own cell.

    parts: heights, highest of the stretches, the gradient across, and which step of the stretch is highest; none where
    they are of one pixel. along: how far along the way the first pixel of a stretch is, and how far each step goes.
    aside: how far to the left of the way the stretch would begin if it were prolonged back to the pixel that looks. By
    how much it leans to the left is the same for all stretches, and left for the end.
    """
    heights, highest, across, place = parts
    (own, columns), (ahead, columns_ahead) = _overlap(gradients.shape, step)
    height, width = own.stop - own.start, columns.stop - columns.start
    if height <= 0 or width <= 0:
        return
    for rows in bands(height, max(1, AT_ONCE // width)):
        here = slice(own.start + rows.start, own.start + rows.stop), columns
        there = slice(ahead.start + rows.start, ahead.start + rows.stop), columns_ahead
        rise = highest[there] - heights[here]
        room = across[here] * np.float32(aside)
        rise -= room
        if place is None:
            rise *= np.float32(1 / along[0])
        else:
            np.multiply(place[there], np.float32(along[1]), out=room)
            room += np.float32(along[0])
            rise /= room
        np.maximum(gradients[here], rise, out=gradients[here])
