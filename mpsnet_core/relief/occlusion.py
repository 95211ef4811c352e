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

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64, Bools
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.errors import SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.height_map import HeightMap, check_size, mean_depth, parallel_heights
from mpsnet_core.scene.normal_map import NormalMap

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


# ----------------------------------------------------------------------------------------------------------------------
# Ambient occlusion from heights: how much of the hemisphere above each pixel is open.


# Limit of the cosine between normal and line of sight, for normals that face away.
MIN_FACING = np.float32(0.05)
# Distance and weight of the neighbours that are averaged on either side; the pixel itself has weight 2. Each of the 4
# positions in a block has the same total weight, 2 of 8, whichever pixel is in the middle.
NEIGHBOURS = ((1, 2), (2, 1))
# Deviations at which a neighbour's weight is halved: from the surface's gradient, in pixels per pixel of distance, and
# of its normal, 1 - cosine (18°).
OFF, TURNED = np.float32(0.5), np.float32(0.05)


@takes_files
def ambient_occlusion(
    heights: HeightMap, normals: NormalMap, *, reach: int | None = None, progress: Progress = silent
) -> F32:
    """The unoccluded fraction of the cosine-weighted hemisphere over each pixel's normal.

    Parameters
    ----------
    heights : HeightMap
        The surface. Nothing behind the visible surface is taken into account.
    normals : NormalMap
        Normals in camera space, of the same size.
    reach : int, optional
        Maximum distance of occluders, in pixels; by default the whole object.
    progress : Progress
        Receives the fraction done and a message.

    Returns
    -------
    (H, W) float32 array
        From 0 to 1; 1 on convex or flat surfaces, and outside the mask.

    Raises
    ------
    GeometryError
        If the sizes differ.
    SettingsError
        If the reach is below 1.

    Notes
    -----
    Horizon-based: the highest elevation of the surface in 16 directions in the image, and the closed-form integral
    between the horizons of two opposite ones (Jimenez et al., Practical Real-Time Strategies for Accurate Indirect
    Occlusion, SIGGRAPH 2016 courses, section 4). As there, each pixel of a 4 x 4 block has 16 directions of its own,
    and the results are averaged over the surface that they share. If all had the same 16, every high edge would cast 16
    straight shadows. At a distance, only the highest pixel of each stretch is used.
    """
    mask = heights.mask
    check_size("height map", mask.shape, normals)
    check_reach(reach)
    farthest = _extent(mask)
    reach = min(reach or farthest, farthest)
    views, all_sectors, spacing = _Views(heights, normals), sectors(), _spacing(heights)
    ground = _ground(heights, views)
    seen, open_sky = np.zeros((2, *ground.heights.shape), np.float32)
    for number, sector in enumerate(all_sectors):
        both: list[F32] = []
        for end in (sector, sector.turned()):
            progress((number + len(both) / 2) / len(all_sectors), "ambient occlusion")
            both.append(horizons(ground, end, reach))
        for cell in np.ndindex(BLOCK, BLOCK):
            way = sector.ways()[cell] * spacing
            for rows in cell_bands(seen):
                share, whole = _slice(views.of(cell, rows), way, [gradients[cell][rows] for gradients in both])
                seen[cell][rows] += np.float32(sector.share) * share
                open_sky[cell][rows] += np.float32(sector.share) * whole
        both.clear()  # before the next ones are made
    seen /= np.maximum(open_sky, np.float32(1e-6), out=open_sky)
    del ground, open_sky
    found = from_cells(np.clip(seen, 0, 1, out=seen), mask.shape)
    del seen
    found = _averaged(found, views)
    found[~mask] = 1
    return found


def check_reach(reach: int | None) -> None:
    """Raise SettingsError if the reach is out of range."""
    if reach is not None and reach < 1:
        raise SettingsError(f"ambient occlusion cannot reach over {reach} pixels; give 1 or more")


def _extent(mask: Bools) -> int:
    """Largest possible distance between two pixels of the mask."""
    return int(hypot(*(side.stop - side.start - 1 for side in bounding_box(mask)))) + 1


def _spacing(heights: HeightMap) -> F64:
    """(2,) distance of a pixel from the next on the right and above, in the unit of :func:`parallel_heights`."""
    return mean_depth(heights) / heights.camera.focal


@dataclass(frozen=True)
class _View:
    """Normals and lines of sight of some pixels, as float32 arrays of one shape."""

    x: F32
    """x of the normal."""
    y: F32
    """y of the normal."""
    upright: F32
    """Cosine between normal and line of sight."""
    right: F32
    """x of the unit vector to the camera."""
    up: F32
    """y of the unit vector to the camera."""
    scale: F32
    """A gradient m of :func:`parallel_heights` along a unit vector e in the image plane is the direction e + m scale
    (right, up, ..)."""

    def facing(self) -> F32:
        """The normal's component along `scale` times the line of sight, the axis of :func:`parallel_heights`."""
        return self.upright * self.scale


class _Views:
    """The views of all pixels, computed when needed: they would take several times the normals' memory."""

    def __init__(self, heights: HeightMap, normals: NormalMap) -> None:
        self.heights, self.normals = heights, normals
        self.middle = np.float32(mean_depth(heights))
        height, width = heights.mask.shape
        self.x = heights.camera.points(np.ones((1, width)))[0, :, 0].astype(np.float32)
        self.y = heights.camera.points(np.ones((height, 1)))[:, :1, 1].astype(np.float32)

    def of(self, cell: tuple[int, ...], rows: slice) -> _View:
        """The view of some rows in one cell. Blocks may exceed the image; there, it is that of the nearest pixel."""
        height, width = self.heights.mask.shape
        lines = np.arange(cell[0] + BLOCK * rows.start, cell[0] + BLOCK * rows.stop, BLOCK)
        columns = np.arange(cell[1], cell[1] + -(-width // BLOCK) * BLOCK, BLOCK)
        return self.at(np.minimum(lines, height - 1), np.minimum(columns, width - 1))

    def at(self, lines: I64, columns: I64) -> _View:
        """The view of the pixels in some rows and columns."""
        part = np.ix_(lines, columns)
        n_x, n_y, n_z = np.ascontiguousarray(np.moveaxis(self.normals.vectors[part], -1, 0))
        if self.heights.camera.projection == "orthographic":
            zero, one = (np.broadcast_to(np.float32(value), n_z.shape) for value in (0, 1))
            return _View(n_x, n_y, n_z, zero, zero, one)
        x, y = self.x[columns], self.y[lines]
        depth = np.where(self.heights.mask[part], -self.heights.values[part], np.float32(1))
        length = np.sqrt(x * x + y * y + 1)
        upright = (n_z - n_x * x - n_y * y) / length
        return _View(n_x, n_y, upright, -x / length, -y / length, depth / self.middle * length)


def _ground(heights: HeightMap, views: _Views) -> OcclusionGrid:
    right, up = _spacing(heights).astype(np.float32)

    def slopes(cell: tuple[int, ...], rows: slice) -> tuple[F32, F32]:
        view = views.of(cell, rows)
        facing = np.maximum(view.facing(), MIN_FACING)
        return -view.x * right / facing, -view.y * up / facing

    return OcclusionGrid(to_cells(parallel_heights(heights)), to_cells(heights.mask), slopes)


def _slice(view: _View, way: F64, gradients: list[F32]) -> tuple[F32, F32]:
    """Ambient light in the plane through the line of sight and a line in the image, with and without occlusion.

    way: (2,) step of one pixel along the line, right and up. gradients: ahead and back along it, per such step.
    """
    length = np.float32(np.hypot(*way))
    east, north = way.astype(np.float32) / length
    lean = east * view.right + north * view.up
    # The length of (east, north, 0) - lean * view, the vector in the plane that is perpendicular to the view:
    aside = np.sqrt(1 - lean * lean)
    tilted = (east * view.x + north * view.y - lean * view.upright) / aside
    upright, rise = view.upright, view.scale / length
    angle, half = np.arctan2(tilted, upright), np.float32(np.pi / 2)
    ahead = np.minimum(np.arctan2(aside, rise * gradients[0] + lean), angle + half)
    behind = np.maximum(-np.arctan2(aside, rise * gradients[1] - lean), angle - half)
    bent = np.cos(2 * ahead - angle) + np.cos(2 * behind - angle)
    share = upright + (ahead + behind) * tilted - np.float32(0.5) * np.sqrt(upright * upright + tilted * tilted) * bent
    return np.float32(0.5) * share, upright + angle * tilted


def _averaged(found: F32, views: _Views) -> F32:
    """(H, W) edge-preserving means over the block around each pixel: only over what is one smooth surface with it.

    Along rows, then along columns, over two neighbours on either side.
    """
    heights = views.heights
    parts = parallel_heights(heights), heights.mask, views.normals.vectors
    right, up = _spacing(heights)
    for axis, pixel in ((1, right), (0, -up)):
        means = np.empty_like(found)
        lines: list[NDArray[Any]] = [np.moveaxis(part, axis, 0) for part in (found, means, *parts)]
        for band in bands(lines[0].shape[1]):
            values, out, raised, mask, vectors = (line[:, band] for line in lines)
            places = [np.arange(length) for length in found.shape]
            places[1 - axis] = places[1 - axis][band]
            facing = np.moveaxis(views.at(*places).facing(), axis, 0)
            leaning = vectors[..., 1 - axis]
            out[:] = _means_along(values, raised, facing, mask, vectors, leaning, np.float32(pixel))
        found = means
    return found


def _means_along(
    values: F32, raised: F32, facing: F32, mask: Bools, vectors: F32, leaning: F32, pixel: np.float32
) -> F32:
    """(N, M) means along the first axis.

    raised: the heights. facing, leaning: components of the normals along the heights and along the axis. pixel: length
    of a step.
    """
    counted = np.full(values.shape, 2, np.float32)
    sums = 2 * values
    for apart, count in NEIGHBOURS:
        one, other = np.s_[apart:], np.s_[:-apart]
        off = (facing[one] + facing[other]) * (raised[one] - raised[other]) / (2 * apart * pixel)
        off += (leaning[one] + leaning[other]) / 2
        turned = 1 - dot(vectors[one], vectors[other])
        weight = count * (mask[one] & mask[other]) / ((1 + np.square(off / OFF)) * (1 + np.square(turned / TURNED)))
        counted[one] += weight
        counted[other] += weight
        sums[one] += weight * values[other]
        sums[other] += weight * values[one]
    return sums / counted
