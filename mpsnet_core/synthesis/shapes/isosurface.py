"""Isosurfaces: triangle meshes of blended solids, by surface nets."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F64, I32, I64, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.shape import Shape, smooth_shape

# --- solids: implicit surfaces by signed distance functions, blended smoothly or subtracted from each other -----------
# Distances and blends after Inigo Quilez, "Distance functions" and "Smooth minimum" (iquilezles.org, 2008 to 2024).


WORLD: F64 = np.eye(3)


@dataclass(frozen=True)
class Solid:
    """A positioned solid."""

    distance: Callable[[F64], F64]
    """Maps local points (3, N) to signed distances (N,), below 0 inside; exact near the surface, elsewhere within a
    third."""
    centre: F64
    """(3,). Position of its centre."""
    axes: F64
    """(3, 3). Rows are the local axes."""
    half: F64
    """(3,). Half the size of its local bounding box."""
    blend: float = 0.0
    """Width of the blend with the solids before it, 0 for a sharp joint."""
    carve: bool = False
    """Whether to subtract it instead."""

    def signed_distance(self, points: F64) -> F64:
        """(N,) signed distances of points (3, N)."""
        return self.distance(self.local(points))

    def local(self, points: F64) -> F64:
        """Points (3, N) in the solid's local space."""
        x, y, z = (points[axis] - self.centre[axis] for axis in range(3))
        if self.axes is WORLD:
            return np.stack([x, y, z])
        return np.stack([row[0] * x + row[1] * y + row[2] * z for row in self.axes])


def limb(start: ArrayLike, end: ArrayLike, r1: float, r2: float, *, blend: float = 0.0, carve: bool = False) -> Solid:
    """A round cone from `start` (radius r1) to `end` (radius r2); a ball if they coincide."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    along = b - a
    square = max(float(along @ along), 1e-12)

    def distance(p: F64) -> F64:
        t: F64 = np.clip((p[0] * along[0] + p[1] * along[1] + p[2] * along[2]) / square + 0.5, 0, 1)
        return lengths(p - (t - 0.5) * along[:, None]) - (r1 + (r2 - r1) * t)

    half = np.abs(along) / 2 + max(r1, r2)
    return Solid(distance, (a + b) / 2, WORLD, half, blend, carve)


def ellipsoid(
    centre: ArrayLike, radii: ArrayLike, axes: ArrayLike = WORLD, *, blend: float = 0.0, carve: bool = False
) -> Solid:
    """An ellipsoid."""
    r = np.broadcast_to(np.asarray(radii, np.float64), 3)[:, None]

    def distance(p: F64) -> F64:
        scaled = lengths(p / r)
        return scaled * (scaled - 1) / np.maximum(lengths(p / r / r), 1e-9)

    return Solid(distance, np.asarray(centre, np.float64), np.asarray(axes, np.float64), r[:, 0], blend, carve)


def box(centre: ArrayLike, half: ArrayLike, rounding: float, axes: ArrayLike = WORLD) -> Solid:
    """A box with rounded edges. half: half of its size, including the rounding."""
    full = np.asarray(half, np.float64)

    def distance(p: F64) -> F64:
        return _rounded(np.abs(p) - (full - rounding)[:, None], rounding)

    return Solid(distance, np.asarray(centre, np.float64), np.asarray(axes, np.float64), full)


def cylinder(centre: ArrayLike, radius: float, half_height: float, rounding: float) -> Solid:
    """An upright cylinder with rounded rims."""

    def distance(p: F64) -> F64:
        outside = np.stack([lengths(p[:2]) - radius, np.abs(p[2]) - half_height]) + rounding
        return _rounded(outside, rounding)

    return Solid(distance, np.asarray(centre, np.float64), WORLD, np.array([radius, radius, half_height]))


def _rounded(outside: F64, rounding: float) -> F64:
    """(N,) distances from a rounded form. outside: (D, N) distances of points beyond its core along each axis."""
    return lengths(np.maximum(outside, 0)) + np.minimum(outside.max(axis=0), 0) - rounding


def blended(a: F64, b: F64, width: float) -> F64:
    """Smooth minimum of two distances, with a continuous second derivative."""
    distance: F64 = np.minimum(a, b)
    if width > 0:
        overlap = np.maximum(1 - np.abs(a - b) / width, 0)
        distance = distance - overlap * overlap * overlap * (width / 6)
    return distance


def lengths(vectors: F64) -> F64:
    """(...) lengths of vectors (D, ...)."""
    return np.sqrt(np.einsum("i...,i...->...", vectors, vectors))


# Points evaluated at a time: temporary arrays stay in the processor's cache.
_CHUNK = 1 << 13
_FAR = 1e3
# Step of the central differences for normals.
_STEP = 2e-4


def isosurface(solids: Sequence[Solid], cell: float) -> Shape:
    """The surface of solids, joined and carved in order. cell: size of the grid cells.

    Naive surface nets (Gibson 1998, "Constrained elastic surface nets"): a vertex in every cell, and a quad for every
    grid edge, that the surface crosses. Vertices are then projected onto the surface and get its normals, which hides
    the grid. The mesh is manifold: ambiguous faces, where inside and outside alternate as on a chessboard, are filled
    first.
    """
    whole = [solid for solid in solids if not solid.carve]
    extents = [np.abs(solid.axes.T) @ solid.half for solid in whole]
    # Blending inflates a joint by at most a sixth of the blend width per solid.
    margin = 3 * cell + max(solid.blend for solid in solids) / 3
    low = np.min([s.centre - e for s, e in zip(whole, extents, strict=True)], axis=0) - margin
    high = np.max([s.centre + e for s, e in zip(whole, extents, strict=True)], axis=0) + margin
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in np.ceil((high - low) / cell) + 1), indexing="ij"))
    values = _distances(solids, low[:, None] + grid.reshape(3, -1) * cell).reshape(grid.shape[1:])

    places, quads = surface_nets(values)
    points = low[:, None] + places * cell
    for _ in range(2):
        points = points - np.clip(_distances(solids, points), -cell, cell) * _normals(solids, points)
    normals = _normals(solids, points)
    return smooth_shape(np.ascontiguousarray(points.T), _split(points.T, quads), normals.T)


def _normals(solids: Sequence[Solid], points: F64) -> F64:
    """(3, N) unit gradients of the distance at points (3, N), by central differences."""
    steps = _STEP * np.eye(3)[..., None]
    rises = [_distances(solids, points + step) - _distances(solids, points - step) for step in steps]
    return normalised(np.stack(rises, axis=1)).T


def _distances(solids: Sequence[Solid], points: F64) -> F64:
    """(N,) signed distances of points (3, N) from the combined surface of the solids, below 0 inside."""
    total = np.full(points.shape[1], _FAR)
    for chunk in bands(len(total), _CHUNK):
        for solid in solids:
            distance = solid.signed_distance(points[:, chunk])
            if solid.carve:
                total[chunk] = -blended(-total[chunk], distance, solid.blend)
            else:
                total[chunk] = blended(total[chunk], distance, solid.blend)
    return total


def surface_nets(values: Floats) -> tuple[F64, I32]:
    """Vertices (3, V) in grid units, and quads (Q, 4), counter-clockwise from outside, of the zero level set.

    values: (X, Y, Z), below 0 inside, above 0 at the border; modified where ambiguous faces are filled.
    """
    sizes = np.array(values.shape)
    corners = list(product((0, 1), repeat=3))
    strides = np.array([sizes[1] * sizes[2], sizes[2], 1])
    while True:
        inside = values < 0
        total = np.zeros(sizes - 1, np.uint8)
        for corner in corners:
            total += inside[tuple(slice(c, c + n - 1) for c, n in zip(corner, sizes, strict=True))]
        cells = np.flatnonzero((total > 0) & (total < 8))
        points = strides @ np.stack(np.unravel_index(cells, total.shape)) + (np.array(corners) @ strides)[:, None]
        boards = _ambiguous_faces(values.reshape(-1)[points])
        if not len(boards):
            break
        values.reshape(-1)[points[boards[:, 0], boards[:, 1]]] = -1e-6

    # A vertex is the mean of the surface's intersections with the edges of its cell.
    number = np.full(total.size, -1, np.int32)
    number[cells] = np.arange(len(cells))
    steps = np.array([(sizes[1] - 1) * (sizes[2] - 1), sizes[2] - 1, 1])  # from cell to cell
    summed, crossings, quads = np.zeros((3, len(cells))), np.zeros(len(cells)), []
    for axis in range(3):
        first, last = (np.moveaxis(np.moveaxis(values, axis, 0)[part], 0, axis) for part in (np.s_[:-1], np.s_[1:]))
        edges = np.nonzero((first < 0) != (last < 0))
        crossing = np.stack(edges).astype(np.float64)
        crossing[axis] += first[edges] / (first[edges] - last[edges])
        second, third = steps[(axis + 1) % 3], steps[(axis + 2) % 3]
        around = number[(steps @ np.stack(edges))[:, None] - np.array([0, second, second + third, third])]
        crossings += np.bincount(around.ravel(), minlength=len(cells))
        summed += [np.bincount(around.ravel(), np.repeat(along, 4), len(cells)) for along in crossing]
        quads.append(np.where((first[edges] < 0)[:, None], around, around[:, ::-1]))
    return summed / crossings, np.concatenate(quads)


def _ambiguous_faces(at: NDArray[np.integer[Any]]) -> I64:
    """(N, 2) corner and cell to fill, for faces whose inside corners are diagonal. at: (8, cells) corner values.

    Of the two outside corners, the one closer to the surface is filled. Only faces at the low sides of cells are
    checked; the others belong to neighbours.
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


def _split(points: F64, quads: I32) -> I32:
    """Triangles of quads, split along the shorter diagonal."""
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    short = ((a - c) ** 2).sum(axis=1) <= ((b - d) ** 2).sum(axis=1)
    one = np.where(short[:, None], quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    two = np.where(short[:, None], quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    return np.stack([one, two], axis=1).reshape(-1, 3).astype(np.int32)
