"""Rasterising triangles to texels; dilating textures past the borders of UV islands."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Triangles of a smaller area, in texels, are degenerate.
NO_AREA = 1e-9
# Texels, and rows of triangles, that are rasterised at once; a hundred bytes each.
AT_ONCE = 1 << 20


def texel_coordinates(uvs: NDArray[np.floating[Any]], size: int) -> NDArray[np.float64]:
    """UVs (..., 2) as texel coordinates: x right, y down, whole numbers at texel centres, row 0 at v = 1."""
    return np.stack([uvs[..., 0] * size - 0.5, (1 - uvs[..., 1].astype(np.float64)) * size - 0.5], axis=-1)


def texel_areas(corners: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(T,) areas in texels of triangles given by texel coordinates (T, 3, 2)."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    doubled: NDArray[np.float64] = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]).astype(np.float64)
    return doubled / 2


def triangle_of_texel(corners: NDArray[np.float64], size: int, rows: slice | None = None) -> NDArray[np.int32]:
    """(size, size) index of the triangle that covers each texel's centre, -1 where none does.

    corners: (T, 3, 2) texel coordinates. rows: only these, from a start to a stop. Where triangles overlap, the highest
    index wins; degenerate ones cover nothing. Memory stays bounded, however many overlap.
    """
    y = corners[..., 1]
    above, below = (0, size) if rows is None else (rows.start, rows.stop)
    top = np.clip(np.ceil(y.min(axis=1)), above, below).astype(np.int64)
    bottom = np.clip(np.floor(y.max(axis=1)) + 1, top, below).astype(np.int64)
    height = np.where(texel_areas(corners) > NO_AREA, bottom - top, 0)
    owner = np.full((below - above) * size, -1, np.int32)
    end = len(corners)
    while end and (owner < 0).any():
        begin = _last_few(height[:end])
        triangle = np.repeat(np.arange(begin, end, dtype=np.int32), height[begin:end])
        row = _counted(top[begin:end], height[begin:end])
        start, stop = _span(corners, triangle, row, size)
        _fill(owner, triangle, (row - above) * np.int64(size) + start, stop - start)
        end = begin
    return owner.reshape(below - above, size)


def _span(
    corners: NDArray[np.float64], triangle: NDArray[np.int32], row: NDArray[np.int32], size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For triangles in rows, each (N,): the first column whose texel centre is covered, and the one after the last."""
    x, y = corners[..., 0], corners[..., 1]
    # Where each of the three edges crosses the row; edges that do not reach it are ignored.
    left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        x0, y0, x1, y1 = x[triangle, first], y[triangle, first], x[triangle, second], y[triangle, second]
        reaches = (np.minimum(y0, y1) <= row) & (np.maximum(y0, y1) >= row)
        level = y1 == y0
        along = np.where(level, 0.0, (row - y0) / np.where(level, 1.0, y1 - y0))
        crossing = x0 + along * (x1 - x0)
        left = np.where(reaches, np.minimum(left, np.where(level, np.minimum(x0, x1), crossing)), left)
        right = np.where(reaches, np.maximum(right, np.where(level, np.maximum(x0, x1), crossing)), right)
    start = np.clip(np.ceil(left), 0, size).astype(np.int64)
    return start, np.clip(np.floor(np.maximum(right, -1.0)) + 1, start, size).astype(np.int64)


def _fill(
    owner: NDArray[np.int32], triangle: NDArray[np.int32], first: NDArray[np.int64], count: NDArray[np.int64]
) -> None:
    """Write triangles, (N,) ascending, to their spans of `count` texels from `first` on, where `owner` is still -1."""
    while len(triangle):
        if count.sum() > np.count_nonzero(owner < 0):  # some overlap, and may be hidden as a whole
            free = np.concatenate([[0], np.cumsum(owner < 0, dtype=np.int32)])
            visible = free[first + count] > free[first]
            triangle, first, count = triangle[visible], first[visible], count[visible]
        begin = _last_few(count)
        texel, new = _counted(first[begin:], count[begin:]), np.repeat(triangle[begin:], count[begin:])
        free = owner[texel] < 0
        owner[texel[free]] = new[free]
        triangle, first, count = triangle[:begin], first[:begin], count[:begin]


def _last_few(counts: NDArray[np.int64]) -> int:
    """Start of the longest tail of counts that sums to at most `AT_ONCE`, at least one of them; 0 if none."""
    few = np.searchsorted(np.cumsum(counts[::-1]), AT_ONCE, side="right")
    return max(len(counts) - max(int(few), 1), 0)


def _counted(start: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.int32]:
    """start[0], start[0] + 1, ... (count[0] of them), start[1], ..."""
    before = np.cumsum(count) - count
    # 16384 x 16384 texels can be numbered in 31 bits.
    return np.arange(int(count.sum()), dtype=np.int32) + np.repeat((start - before).astype(np.int32), count)


def extend_to_nearest(
    values: NDArray[np.float32], filled: NDArray[np.bool_], distance: int, *, in_place: bool = False
) -> NDArray[np.float32]:
    """`values` (S, S, C) with the texels within `distance` of the filled ones set to their nearest one's value.

    Without such a margin, filtering and mipmaps bleed the background into the UV islands.
    """
    # A border that counts as done, so that steps never leave the texture.
    done = np.pad(filled, 1, constant_values=True)
    stride = done.shape[1]
    steps = np.array([-stride, stride, -1, 1, -stride - 1, -stride + 1, stride - 1, stride + 1])
    across = done[:, :-2] & done[:, 1:-1] & done[:, 2:]
    surrounded = across[:-2] & across[1:-1] & across[2:]
    front = np.flatnonzero(np.pad(filled & ~surrounded, 1))
    del across, surrounded
    source = front  # the filled texel nearest to each texel of the front
    flat = done.ravel()
    reached, origins = [front[:0]], [front[:0]]
    for _ in range(distance):
        if not len(front):
            break
        neighbours = (front[:, None] + steps).T.ravel()
        new = ~flat[neighbours]
        source = np.tile(source, len(steps))[new]
        front, first = np.unique(neighbours[new], return_index=True)
        source = source[first]
        flat[front] = True
        reached.append(front)
        origins.append(source)
    out = values if in_place else values.copy()
    rows, columns = np.divmod(np.concatenate(reached), stride)
    from_rows, from_columns = np.divmod(np.concatenate(origins), stride)
    out[rows - 1, columns - 1] = values[from_rows - 1, from_columns - 1]
    return out
