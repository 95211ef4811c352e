"""Isosurface: a triangle mesh of blended solids, by surface nets."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.scene.normal_map import normalised
from mpsnet_core.synthesis.shapes.shape import Shape, smooth_shape
from mpsnet_core.synthesis.shapes.solids import Solid, blended

# Points evaluated at once: their temporaries stay in the processor's cache.
_CHUNK = 1 << 13
_FAR = 1e3
# Step of the central differences that yield normals.
_STEP = 2e-4


def isosurface(solids: Sequence[Solid], cell: float) -> Shape:
    """The surface of solids, joined and carved in their order, on a grid of cells of this size.

    Naive surface nets (Gibson 1998, "Constrained elastic surface nets"): a vertex in every cell that the surface
    crosses, a quad for every edge of the grid that it crosses. The vertices are then moved onto the surface itself, and
    have its exact normals, so that the grid does not show. Every edge has two triangles: where inside and outside meet
    as on a chessboard, the gap is filled first.
    """
    whole = [solid for solid in solids if not solid.carve]
    extents = [np.abs(solid.axes.T) @ solid.half for solid in whole]
    # Blending swells a joint by at most a sixth of its width for each solid in it.
    margin = 3 * cell + max(solid.blend for solid in solids) / 3
    low = np.min([s.centre - e for s, e in zip(whole, extents, strict=True)], axis=0) - margin
    high = np.max([s.centre + e for s, e in zip(whole, extents, strict=True)], axis=0) + margin
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in np.ceil((high - low) / cell) + 1), indexing="ij"))
    values = _distances(solids, low[:, None] + grid.reshape(3, -1) * cell).reshape(grid.shape[1:])

    places, slopes, quads = surface_nets(values)
    points = low[:, None] + places * cell
    slopes /= cell
    slopes /= np.maximum((slopes**2).sum(axis=0), 0.25)
    for _ in range(2):
        points = points - np.clip(_distances(solids, points), -cell, cell) * slopes
    steps = _STEP * np.eye(3)[..., None]
    normals = normalised(
        np.stack([_distances(solids, points + step) - _distances(solids, points - step) for step in steps], axis=1)
    )
    return smooth_shape(np.ascontiguousarray(points.T), _split(points.T, quads), normals)


def _distances(solids: Sequence[Solid], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) distances of points (3, N) from the solids' common surface, below 0 inside."""
    total = np.full(points.shape[1], _FAR)
    for start in range(0, len(total), _CHUNK):
        chunk = slice(start, start + _CHUNK)
        for solid in solids:
            distance = solid.signed_distance(points[:, chunk])
            if solid.carve:
                total[chunk] = -blended(-total[chunk], distance, solid.blend)
            else:
                total[chunk] = blended(total[chunk], distance, solid.blend)
    return total


def surface_nets(
    values: NDArray[Any],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (3, V) in grid units, the values' gradients there (3, V), and quads (Q, 4) of where values change sign.

    values: (X, Y, Z), below 0 inside, above 0 all around the border; changed where chessboard faces are filled. The
    quads are counter-clockwise from outside.
    """
    sizes = np.array(values.shape)
    corners = list(product((0, 1), repeat=3))
    strides = np.array([sizes[1] * sizes[2], sizes[2], 1])
    steps = np.array(corners) @ strides
    while True:
        inside = values < 0
        total = np.zeros(sizes - 1, np.uint8)
        for corner in corners:
            total += inside[tuple(slice(c, c + n - 1) for c, n in zip(corner, sizes, strict=True))]
        cells = np.flatnonzero((total > 0) & (total < 8))
        low = np.stack(np.unravel_index(cells, total.shape))
        points = (strides @ low)[None] + steps[:, None]
        at = values.reshape(-1)[points]
        boards = _chessboards(at)
        if not len(boards):
            break
        values.reshape(-1)[points[boards[:, 0], boards[:, 1]]] = -1e-6
    number = np.full(total.size, -1, np.int32)
    number[cells] = np.arange(len(cells))

    summed, crossings = np.zeros((3, len(cells))), np.zeros(len(cells))
    slopes = np.zeros((3, len(cells)))
    for axis, a in ((axis, a) for axis in range(3) for a in range(8) if not corners[a][axis]):
        b = a + (4, 2, 1)[axis]
        rise = at[b] - at[a]
        slopes[axis] += rise / 4
        crossed = (at[a] < 0) != (at[b] < 0)
        for other in range(3):
            if other != axis and corners[a][other]:
                summed[other] += crossed
        summed[axis] -= np.where(crossed, at[a] / np.where(crossed, rise, 1), 0)
        crossings += crossed
    places = low + summed / crossings

    # Cells are numbered in a grid one smaller than that of the points.
    steps = np.array([(sizes[1] - 1) * (sizes[2] - 1), sizes[2] - 1, 1])
    quads = []
    for axis in range(3):
        first = inside[tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))]
        last = inside[tuple(slice(1, None) if k == axis else slice(None) for k in range(3))]
        edges = np.flatnonzero(first != last)
        leaving = first.reshape(-1)[edges]
        point = steps @ np.stack(np.unravel_index(edges, first.shape))
        second, third = steps[(axis + 1) % 3], steps[(axis + 2) % 3]
        around = number[point[:, None] - np.array([0, second, second + third, third])]
        quads.append(np.where(leaving[:, None], around, around[:, ::-1]))
    return places, slopes, np.concatenate(quads)


def _chessboards(at: NDArray[Any]) -> NDArray[np.int64]:
    """(N, 2) corner and cell to fill where a cell's face has inside only across; at: (8, cells) values at the corners.

    Of the two outside corners the nearer one. Only faces at a cell's low side: the others belong to its neighbours.
    """
    found = []
    for a, b, c, d in ((0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6)):
        one, two = (at[a] < 0) & (at[d] < 0), (at[b] < 0) & (at[c] < 0)
        outside = (at[a] >= 0) & (at[d] >= 0)
        first = np.flatnonzero(one & (at[b] >= 0) & (at[c] >= 0))
        second = np.flatnonzero(two & outside)
        found.append(np.column_stack([np.where(at[b, first] < at[c, first], b, c), first]))
        found.append(np.column_stack([np.where(at[a, second] < at[d, second], a, d), second]))
    return np.concatenate(found)


def _split(points: NDArray[np.float64], quads: NDArray[np.int32]) -> NDArray[np.int32]:
    """Triangles of quads, parted along the shorter diagonal."""
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    short = ((a - c) ** 2).sum(axis=1) <= ((b - d) ** 2).sum(axis=1)
    one = np.where(short[:, None], quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    two = np.where(short[:, None], quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    triangles: NDArray[np.int32] = np.stack([one, two], axis=1).reshape(-1, 3).astype(np.int32)
    return triangles
