"""Rasterising triangles to texels; dilating textures past the borders of UV islands."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import ROWS, bands, on_all_cores
from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools, Floats

# Triangles of a smaller area, in texels, are degenerate.
NO_AREA = 1e-9
# Texels, and triangle rows, that are rasterised at once; a hundred bytes each.
AT_ONCE = 1 << 20


# Width and height of a texture, or the side of a square one.
TextureSize = int | tuple[int, int]


def width_and_height(size: TextureSize) -> tuple[int, int]:
    return (size, size) if isinstance(size, int) else size


def texel_coordinates(uvs: Floats, size: TextureSize) -> F64:
    """UVs (..., 2) as texel coordinates: x right, y down, whole numbers at texel centres, row 0 at v = 1."""
    width, height = width_and_height(size)
    u, v = uvs[..., 0].astype(np.float64), uvs[..., 1].astype(np.float64)
    return np.stack([u * width - 0.5, (1 - v) * height - 0.5], axis=-1)


def texel_areas(corners: Floats) -> F64:
    """(T,) areas in texels of triangles given by texel coordinates (T, 3, 2)."""
    # In double precision, as files hold UVs of any size.
    e1, e2 = (np.subtract(corners[:, number], corners[:, 0], dtype=np.float64) for number in (1, 2))
    doubled: F64 = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])
    return doubled / 2


def triangle_of_texel(corners: F64, size: TextureSize) -> I32:
    """(H, W) index of the triangle that covers each texel's centre, -1 where none does.

    corners: (T, 3, 2) texel coordinates. Where triangles overlap, the highest index wins. Degenerate ones cover
    nothing. Memory is bounded, however many overlap.
    """
    return Raster(corners, size).rows(slice(0, width_and_height(size)[1]))


class Raster:
    """The result of :func:`triangle_of_texel`, a few rows at a time."""

    def __init__(self, corners: F64, size: TextureSize) -> None:
        self.width, height = width_and_height(size)
        y = corners[..., 1]
        self.top = np.clip(np.ceil(y.min(axis=1)), 0, height).astype(np.int32)
        self.bottom = np.clip(np.floor(y.max(axis=1)) + 1, self.top, height).astype(np.int32)
        self.bottom[texel_areas(corners) <= NO_AREA] = 0
        # (2, 3, T): x and y of each corner, with consecutive triangles contiguous in memory.
        self.x, self.y = np.ascontiguousarray(corners.T)

    def rows(self, rows: slice) -> I32:
        """(R, W) index of the triangle that covers each texel's centre in these rows."""
        near = np.flatnonzero((self.bottom > rows.start) & (self.top < rows.stop))
        top = np.maximum(self.top[near], rows.start).astype(np.int64)
        height = np.minimum(self.bottom[near], rows.stop) - top
        owner = np.full((rows.stop - rows.start) * self.width, -1, np.int32)
        end = len(near)
        while end and (owner < 0).any():
            begin = _last_few(height[:end])
            triangle = np.repeat(near[begin:end], height[begin:end])
            row = _counted(top[begin:end], height[begin:end])
            start, stop = self._span(triangle, row)
            _fill(owner, triangle, (row - rows.start) * self.width + start, stop - start)
            end = begin
        return owner.reshape(rows.stop - rows.start, self.width)

    def _span(self, triangle: I64, row: I64) -> tuple[I64, I64]:
        """For triangles in rows, each (N,): the first covered column, by texel centres, and the one after the last."""
        x, y = self.x.take(triangle, axis=1), self.y.take(triangle, axis=1)
        # Where each of the three edges crosses the row; edges that do not reach it are ignored.
        left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
        for first, second in ((0, 1), (1, 2), (2, 0)):
            x0, y0, x1, y1 = x[first], y[first], x[second], y[second]
            reaches = (np.minimum(y0, y1) <= row) & (np.maximum(y0, y1) >= row)
            level = y1 == y0
            along = np.where(level, 0.0, (row - y0) / np.where(level, 1.0, y1 - y0))
            crossing = x0 + along * (x1 - x0)
            np.minimum(left, np.where(level, np.minimum(x0, x1), crossing), out=left, where=reaches)
            np.maximum(right, np.where(level, np.maximum(x0, x1), crossing), out=right, where=reaches)
        start = np.clip(np.ceil(left), 0, self.width).astype(np.int64)
        return start, np.clip(np.floor(np.maximum(right, -1.0)) + 1, start, self.width).astype(np.int64)


def _fill(owner: I32, triangle: I64, first: I64, count: I64) -> None:
    """Write triangles, (N,) ascending, to their spans of `count` texels from `first` on, where `owner` is still -1."""
    while len(triangle):
        unowned = np.count_nonzero(owner < 0)
        if count.sum() > unowned:  # some overlap, and may be hidden entirely
            free = np.concatenate([[0], np.cumsum(owner < 0, dtype=np.int32)])
            visible = free[first + count] > free[first]
            triangle, first, count = triangle[visible], first[visible], count[visible]
        begin = _last_few(count)
        texel = _counted(first[begin:], count[begin:])
        new = np.repeat(triangle[begin:].astype(np.int32), count[begin:])
        if unowned < len(owner):
            free = np.flatnonzero(owner.take(texel) < 0)
            texel, new = texel.take(free), new.take(free)
        owner[texel] = new  # the last of several is written last
        triangle, first, count = triangle[:begin], first[:begin], count[:begin]


def _last_few(counts: I64) -> int:
    """Start of the longest tail of counts that sums to at most `AT_ONCE`, at least one of them; 0 if none."""
    few = np.searchsorted(np.cumsum(counts[::-1]), AT_ONCE, side="right")
    return max(len(counts) - max(int(few), 1), 0)


def _counted(start: I64, count: I64) -> I64:
    """start[0], start[0] + 1, ... (count[0] of them), start[1], ..."""
    before = np.cumsum(count) - count
    return np.arange(int(count.sum())) + np.repeat(start - before, count)


def extend_to_nearest(values: F32, filled: Bools, distance: int, *, in_place: bool = False) -> F32:
    """`values` (S, S, C) with the texels within `distance` of the filled ones set to their nearest one's value.

    Without such a margin, filtering and mipmaps bleed the background into the UV islands.
    """
    out = np.require(values if in_place else values.copy(), requirements="C")
    (height, width), channels = filled.shape, values.shape[2]
    flat = out.reshape(-1, channels)

    def extend(rows: slice) -> None:
        top, bottom = max(rows.start - distance, 0), min(rows.stop + distance, height)
        for texel, source in _nearest(filled[top:bottom], distance, top * width):
            own = np.flatnonzero((texel >= rows.start * width) & (texel < rows.stop * width))
            # Only filled texels are read, and only others are written: bands are independent.
            put_rows(flat, texel.take(own), flat.take(source.take(own), axis=0))

    on_all_cores(extend, bands(height, max(ROWS, 4 * distance)))
    return out


def _nearest(filled: Bools, distance: int, first: int) -> Iterator[tuple[I64, I64]]:
    """Flat indices, from `first` on, of the texels that are 1, 2, ... `distance` away from the filled ones, and of the
    filled texel nearest to each."""
    # A border that counts as done keeps steps within the texture.
    done = np.pad(filled, 1, constant_values=True)
    stride = done.shape[1]
    across = done[:, :-2] & done[:, 1:-1] & done[:, 2:]
    surrounded = across[:-2] & across[1:-1] & across[2:]
    flat, rim = done.ravel(), filled & ~surrounded
    # Of each texel of the front, the place in `flat`, and the filled texel nearest to it.
    front, source = np.flatnonzero(np.pad(rim, 1)), np.flatnonzero(rim) + first
    for _ in range(distance):
        ahead, sources = list[I64](), list[I64]()
        # Up, down, left, right; then from those up and from those down, as only there a diagonal step finds new ones.
        for step, after in ((-stride, None), (stride, None), (-1, None), (1, None), (-1, 0), (1, 0), (-1, 1), (1, 1)):
            near, own = (front, source) if after is None else (ahead[after], sources[after])
            new = np.flatnonzero(~flat.take(near + step))
            ahead.append(near.take(new) + step)
            sources.append(own.take(new))
            flat[ahead[-1]] = True
        front, source = np.concatenate(ahead), np.concatenate(sources)
        if not len(front):
            break
        yield front - 2 * (front.astype(np.int32) // np.int32(stride)) + (first + 1 - stride), source


def put_rows(out: NDArray[Any], places: I64, rows: NDArray[Any]) -> None:
    """``out[places] = rows`` for a contiguous array (M, K) and rows (N, K), in a fifth of the time."""
    row = np.dtype((np.void, out.itemsize * out.shape[1]))
    np.put(out.view(row), places, np.ascontiguousarray(rows, out.dtype).view(row))
