"""The pixel grids that dense networks run on: the picture's own, or one that is turned against it.

Both are read and written a window at a time, so that a turned picture need never stand in memory as a whole.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.normals import normalised

Window = tuple[slice, slice]

# A turned pixel is inside the mask from this bilinear coverage on. No pixel of the picture is further than 1/sqrt(2)
# from the nearest turned one, which therefore covers it by a quarter or more: all of them get an answer.
LEAST_COVERAGE = 0.249

# Pixels resampled at a time: what is worked on stays in the processor's cache.
CHUNK = 16384


class Grid(Protocol):
    """A grid of (height, width) `shape` around the object; an answer is read `margin` pixels around where it goes."""

    @property
    def shape(self) -> tuple[int, int]: ...

    @property
    def margin(self) -> int: ...

    def read(self, window: Window) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Photo (h, w, 3) and mask (h, w) of a window."""

    def write(self, place: Window, around: Window, answer: NDArray[np.float32], inside: NDArray[np.bool_]) -> None:
        """Add the answer of a tile, (4, h, w): three of a normal, one of confidence, to the picture's own.

        place: the tile. around: the tile with its margin, which `answer` and the mask `inside` are of.
        """


class StraightGrid:
    """The picture's own pixels inside the mask's bounding box."""

    margin = 0

    def __init__(self, image: NDArray[np.float32], mask: NDArray[np.bool_], answer: NDArray[np.float32]) -> None:
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        self._image, self._mask, self._answer = image[box], mask[box], answer[box]
        self.shape = rows[-1] + 1 - rows[0], columns[-1] + 1 - columns[0]

    def read(self, window: Window) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        return self._image[window], self._mask[window]

    def write(self, place: Window, around: Window, answer: NDArray[np.float32], inside: NDArray[np.bool_]) -> None:
        self._answer[place] += (answer * inside).transpose(1, 2, 0)


class TurnedGrid:
    """A grid in which the picture lies turned counter-clockwise by `angle` degrees about its centre.

    Pixels are point samples at the centres of their squares, on both grids; both have the same spacing.
    """

    margin = 2

    def __init__(
        self, image: NDArray[np.float32], mask: NDArray[np.bool_], answer: NDArray[np.float32], angle: float
    ) -> None:
        self._image, self._mask, self._answer = image, mask, answer
        self._sine, self._cosine = float(np.sin(np.radians(angle))), float(np.cos(np.radians(angle)))
        self._centre = (mask.shape[0] - 1) / 2, (mask.shape[1] - 1) / 2
        self._corner = 0.0, 0.0
        rows = np.flatnonzero(mask.any(axis=1))
        ends = np.stack([mask[rows].argmax(axis=1), mask.shape[1] - 1 - mask[rows, ::-1].argmax(axis=1)])
        y, x = self._turned(np.broadcast_to(rows, ends.shape), ends)
        self._corner = float(np.floor(y.min())) - 1, float(np.floor(x.min())) - 1
        self.shape = int(np.floor(y.max() - self._corner[0])) + 3, int(np.floor(x.max() - self._corner[1])) + 3

    def _turned(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> tuple[NDArray[np.float64], ...]:
        """Where pixels of the picture lie on the grid: row and column."""
        y, x = rows - self._centre[0], columns - self._centre[1]
        return (
            self._cosine * y - self._sine * x - self._corner[0],
            self._sine * y + self._cosine * x - self._corner[1],
        )

    def _in_picture(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> tuple[NDArray[np.float64], ...]:
        """Where pixels of the grid lie in the picture: row and column."""
        y, x = rows + self._corner[0], columns + self._corner[1]
        return (
            self._cosine * y + self._sine * x + self._centre[0],
            self._cosine * x - self._sine * y + self._centre[1],
        )

    def read(self, window: Window) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        rows, columns = np.ogrid[window]
        y, x = self._in_picture(rows, columns)
        # The pixels of the picture that the kernel reaches; beyond its edges there are none.
        top, left = int(np.floor(y.min())) - 1, int(np.floor(x.min())) - 1
        bottom, right = int(np.floor(y.max())) + 3, int(np.floor(x.max())) + 3
        held = slice(max(top, 0), max(bottom, 0)), slice(max(left, 0), max(right, 0))
        planes = np.zeros((3, bottom - top, right - left), np.float32)
        inside = np.zeros(planes.shape[1:], bool)
        mask = self._mask[held]
        there = tuple(
            slice(begin.start - first, begin.start - first + size)
            for begin, first, size in zip(held, (top, left), mask.shape, strict=True)
        )
        np.multiply(self._image[held].transpose(2, 0, 1), mask, out=planes[:, there[0], there[1]])
        inside[there] = mask
        values, covered = resampled(planes, inside, (y - top).ravel(), (x - left).ravel())
        return values.T.reshape(*y.shape, 3), covered.reshape(y.shape)

    def write(self, place: Window, around: Window, answer: NDArray[np.float32], inside: NDArray[np.bool_]) -> None:
        (top, bottom), (left, right) = ((edge.start, edge.stop) for edge in place)
        y, x = self._in_picture(np.array([[top], [bottom]]), np.array([[left, right]]))
        held = (
            slice(max(int(np.floor(y.min())), 0), max(int(np.ceil(y.max())) + 1, 0)),
            slice(max(int(np.floor(x.min())), 0), max(int(np.ceil(x.max())) + 1, 0)),
        )
        mask = self._mask[held]
        y, x = self._turned(
            *np.ogrid[held[0].start : held[0].start + len(mask), held[1].start : held[1].start + mask.shape[1]]
        )
        # Every pixel belongs to the one tile that it lies in.
        here = mask & (y >= top) & (y < bottom) & (x >= left) & (x < right)
        values, _ = resampled(answer * inside, inside, y[here] - around[0].start, x[here] - around[1].start)
        values[:3] = normalised(values[:3].T).T
        tile = np.zeros((*mask.shape, 4), np.float32)
        tile[here] = values.T
        self._answer[held] += tile


def resampled(
    planes: NDArray[np.float32], mask: NDArray[np.bool_], y: NDArray[np.float64], x: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Values between pixels, from pixels inside the mask alone.

    planes: (C, H, W), zero outside the mask. mask: (H, W). y, x: (N,) row and column, from 1 up to H - 2 or W - 2, so
    that four pixels are there each way. Returns (C, N) values, zero where not covered, and (N,) whether the mask covers
    the place.

    Cubic convolution (Keys 1981, a = -1/2), divided by the weight that fell inside the mask, and kept within what the
    nearest four of those hold: no ringing beside shadows, no light where there was none, nothing above a camera's clip.
    """
    width = mask.shape[1]
    weight = mask.astype(np.float32).ravel()
    flat = [plane.ravel() for plane in planes]
    deep = _deep(mask).ravel()
    values, covered = np.zeros((len(flat), len(y)), np.float32), np.zeros(len(y), bool)
    for start in range(0, len(y), CHUNK):
        chunk = slice(start, start + CHUNK)
        row, column = np.floor(y[chunk]), np.floor(x[chunk])
        base = row.astype(np.intp) * width + column.astype(np.intp)
        down, right = (y[chunk] - row).astype(np.float32), (x[chunk] - column).astype(np.float32)
        covered[chunk] = inside = deep.take(base)
        inner, edge = np.flatnonzero(inside), np.flatnonzero(~inside)
        if not len(edge):
            values[:, chunk] = _convolved(flat, width, base, down, right)
            continue
        if len(inner):
            values[:, inner + start] = _convolved(flat, width, base[inner], down[inner], right[inner])
        base, down, right = base[edge], down[edge], right[edge]
        upper = (1 - right) * weight.take(base) + right * weight.take(base + 1)
        lower = (1 - right) * weight.take(base + width) + right * weight.take(base + width + 1)
        inside = (1 - down) * upper + down * lower > LEAST_COVERAGE
        if inside.any():
            edge, base, down, right = edge[inside] + start, base[inside], down[inside], right[inside]
            covered[edge] = True
            values[:, edge] = _convolved(flat, width, base, down, right, weight)
    return values, covered


def _deep(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where all the 4 x 4 pixels that count for places right of and below a pixel are inside the mask."""
    deep = np.zeros_like(mask)
    across = mask[:, :-3] & mask[:, 1:-2] & mask[:, 2:-1] & mask[:, 3:]
    deep[1:-2, 1:-2] = across[:-3] & across[1:-2] & across[2:-1] & across[3:]
    return deep


def _convolved(
    planes: Sequence[NDArray[np.float32]],
    width: int,
    base: NDArray[np.intp],
    down: NDArray[np.float32],
    right: NDArray[np.float32],
    weight: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Values right of and below the pixels `base` of flat planes; weight: 1 inside the mask, where that is not all."""
    sums = np.zeros((len(planes), len(base)), np.float32)
    total = np.zeros(len(base), np.float32)
    least, most = np.full_like(sums, np.inf), np.full_like(sums, -np.inf)
    kernel_y, kernel_x = _keys(down), _keys(right)
    for row in range(4):
        for column in range(4):
            place = base + ((row - 1) * width + column - 1)
            share = kernel_y[row] * kernel_x[column]
            if weight is not None:
                inside = weight.take(place)
                total += share * inside
                beyond = np.where(inside > 0, np.float32(0), np.float32(np.inf))
            for number, plane in enumerate(planes):
                value = plane.take(place, mode="clip")
                if row in (1, 2) and column in (1, 2):
                    np.minimum(least[number], value if weight is None else value + beyond, out=least[number])
                    np.maximum(most[number], value if weight is None else value - beyond, out=most[number])
                value *= share
                sums[number] += value
    if weight is not None:
        sums /= np.maximum(total, 0.1)
    return np.clip(sums, least, most, out=sums)


def _keys(t: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Weights of the pixels at -1, 0, 1 and 2 for places at 0 <= t < 1."""
    return [
        ((-0.5 * t + 1) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1,
        ((-1.5 * t + 2) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    ]
