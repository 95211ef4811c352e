"""MikkTSpace tangents of a triangle mesh, as Blender's ``Mesh.calc_tangents`` and other tools compute them.

After Morten S. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008) and his public mikktspace.c, rewritten for
NumPy because no maintained Python package provides it on all platforms.
"""

from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.mask_regions import connected
from mpsnet_core.arrays.types import F32, F64, I64, Bools
from mpsnet_core.arrays.unit_vectors import dot, normalised

# A mesh further from the origin than this many times its size is moved there: positions are compared in single
# precision, as in mikktspace.c, and in survey coordinates neighbouring vertices would coincide.
FAR = 16


def mikktspace_tangents(
    corners: ArrayLike, normals: ArrayLike, uvs: ArrayLike, polygons: NDArray[np.integer[Any]] | None = None
) -> F32:
    """Tangent and bitangent sign for every corner of every triangle.

    Parameters
    ----------
    corners, normals, uvs : (T, 3, 3), (T, 3, 3) and (T, 3, 2) arrays
        Positions, unit shading normals and UVs of the corners.
    polygons : (T,) integer array, optional
        The polygon of each triangle, those of one polygon in a row. Two triangles of one polygon are a quad. Its
        tangents are those of the split along its shorter diagonal in UV space, whichever way it is split here.
        Triangles of larger polygons are independent, as all are by default.

    Returns
    -------
    (T, 3, 4) float32 array
        A unit tangent perpendicular to the corner's normal, then the sign s of the bitangent B = s N x T.

    Notes
    -----
    Corners that share position, normal and UV, and whose triangles share an edge and have the same orientation in UV
    space, share one tangent: the mean of their triangles' tangents, weighted by the triangles' angles there. Triangles
    without area in UV space belong to their neighbours' groups; a corner without a tangent after that copies one from a
    corner at the same vertex, else at the same position of its quad, else it is +x. mikktspace.c leaves zero at the few
    corners whose angle is too small for single precision (about 5e-4 rad); here they have the unit tangent.
    """
    corners, normals = _near_origin(np.asarray(corners, np.float64)), np.asarray(normals, np.float64)
    uvs = np.asarray(uvs, np.float64)
    vertex = _welded(corners, normals, uvs)
    if polygons is None:
        tangents = _tangents(corners, normals, uvs, vertex, np.empty(0, np.int64))
    else:
        quads = _Quads.of(polygons, vertex)
        split = quads.split(corners, uvs)
        points, across, layout = (a.reshape(-1, a.shape[-1])[split] for a in (corners, normals, uvs))
        tangents = np.empty((vertex.size, 4))
        tangents[split.ravel()] = _tangents(points, across, layout, vertex.ravel()[split], quads.first)
        quads.complete(tangents, corners.reshape(-1, 3))
    tangents[~tangents[:, :3].any(axis=1)] = [1.0, 0.0, 0.0, -1.0]
    return tangents.reshape(-1, 3, 4).astype(np.float32)


def _near_origin(corners: F64) -> F64:
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    middle: F64 = (low + high) / 2
    return corners - middle if np.linalg.norm(middle) > FAR * np.linalg.norm(high - low) else corners


def _tangents(corners: F64, normals: F64, uvs: F64, vertex: I64, quads: I64) -> F64:
    """(3T, 4) tangents of triangles, zero where undefined. quads: first triangle of each; the second is the next."""
    directions, areas, usable = _triangle_tangents(corners, uvs)
    distinct = _three_places(corners)
    usable &= distinct
    pairs = _meeting_edges(vertex, distinct)
    turns = _adopted(_turned_alike(areas, usable, distinct, quads), usable, pairs)

    # The triangle's tangent in each corner's own tangent plane, weighted by the triangle's angle there.
    projected = _normalised_or_zero(_in_plane(directions[:, None], normals))
    ahead = _normalised_or_zero(_in_plane(np.roll(corners, -1, axis=1) - corners, normals))
    behind = _normalised_or_zero(_in_plane(np.roll(corners, 1, axis=1) - corners, normals))
    angles = np.arccos(np.clip(dot(ahead, behind), -1, 1))
    weighted = np.where(usable[:, None, None], projected * angles[..., None], 0).reshape(-1, 3)

    group = _groups(pairs, turns)
    count = int(group.max()) + 1
    summed: F64 = np.stack([np.bincount(group, weighted[:, axis], count) for axis in range(3)], axis=-1)
    tangents = np.empty((len(group), 4))
    tangents[:, :3] = _normalised_or_zero(summed)[group]
    tangents[:, 3] = np.where(np.repeat(turns, 3), 1.0, -1.0)

    # Corners without a tangent copy that of the first corner at the same welded vertex that has one.
    flat_vertex = vertex.ravel()
    defined = tangents[:, :3].any(axis=1)
    with_tangent, without = np.flatnonzero(defined), np.flatnonzero(~defined)
    first_corner = np.full(int(flat_vertex.max()) + 1, -1)
    first_corner[flat_vertex[with_tangent[::-1]]] = with_tangent[::-1]
    source = first_corner[flat_vertex[without]]
    tangents[without[source >= 0]] = tangents[source[source >= 0]]
    return tangents


@dataclass(frozen=True)
class _Quads:
    """The Q quads among the triangles. Corners have flat indices, three per triangle."""

    first: I64
    """(Q,). First triangle of each; the second one is the next."""
    around: I64
    """(Q, 4). Its corners in order."""
    diagonal: I64
    """(Q, 2). The other two of the six corners."""
    twins: I64
    """(Q, 2). The corners in `around` that these duplicate."""
    triangles: int
    """Number of all triangles."""

    @classmethod
    def of(cls, polygons: NDArray[np.integer[Any]], vertex: I64) -> "_Quads":
        starts = np.flatnonzero(np.diff(polygons, prepend=polygons[0] - 1))
        first = starts[np.diff(starts, append=len(polygons)) == 2]
        # The corners 0, 1, 2 and 0, 2, 3, or 0, 1, 3 and 1, 2, 3.
        one, other = vertex[first], vertex[first + 1]
        at_0 = (one[:, 0] == other[:, 0]) & (one[:, 2] == other[:, 1])
        known = at_0 | ((one[:, 1] == other[:, 0]) & (one[:, 2] == other[:, 2]))
        first, at_0 = first[known], at_0[known, None]

        def numbered(one: list[int], other: list[int]) -> I64:
            return 3 * first[:, None] + np.where(at_0, one, other)

        around = numbered([0, 1, 2, 5], [0, 1, 4, 2])
        return cls(first, around, numbered([3, 4], [3, 5]), numbered([0, 2], [1, 2]), len(vertex))

    def split(self, corners: F64, uvs: F64) -> I64:
        """(T, 3) corners of all triangles, each quad divided along its shorter diagonal."""

        def diagonals(points: F64) -> F32:
            """(Q, 2) squared lengths from corner 0 to 2 and from 1 to 3, in single precision as in mikktspace.c."""
            placed = points.reshape(-1, points.shape[-1])[self.around].astype(np.float32)
            with np.errstate(over="ignore"):
                squared: F32 = ((placed[:, 2:] - placed[:, :2]) ** 2).sum(axis=-1)
            return squared

        in_uv, in_space = diagonals(uvs), diagonals(corners)
        from_0 = np.where(in_uv[:, 0] == in_uv[:, 1], in_space[:, 0] <= in_space[:, 1], in_uv[:, 0] < in_uv[:, 1])
        split = np.arange(3 * self.triangles).reshape(-1, 3)
        split[self.first] = np.where(from_0[:, None], self.around[:, [0, 1, 2]], self.around[:, [0, 1, 3]])
        split[self.first + 1] = np.where(from_0[:, None], self.around[:, [0, 2, 3]], self.around[:, [1, 2, 3]])
        return split

    def complete(self, tangents: F64, places: F64) -> None:
        """Copy tangents to the corners of each quad that have none. tangents: (3T, 4). places: (3T, 3) positions."""
        missing: Bools = ~np.any(tangents[self.around, :3], axis=-1)
        some = np.flatnonzero(missing.any(axis=1))
        for one, other in permutations(range(4), 2):
            to, source = self.around[some, one], self.around[some, other]
            copied = missing[some, one] & ~missing[some, other] & np.all(places[to] == places[source], axis=1)
            tangents[to[copied]] = tangents[source[copied]]
        tangents[self.diagonal] = tangents[self.twins]


def _turned_alike(areas: F64, usable: Bools, distinct: Bools, quads: I64) -> Bools:
    """Whether each triangle is counter-clockwise in UV space. If a quad's two differ, the larger one decides."""
    turns = areas > 0
    other = quads + 1
    differ = (turns[quads] != turns[other]) & distinct[quads] & distinct[other]
    as_first = ~usable[other] | (np.abs(areas[quads]) >= np.abs(areas[other]))
    turns[other[differ & as_first]] = turns[quads[differ & as_first]]
    turns[quads[differ & ~as_first]] = turns[other[differ & ~as_first]]
    return turns


def _normalised_or_zero(vectors: F64) -> F64:
    """Vectors (..., 3) scaled to unit length; zero vectors stay zero."""
    return np.asarray(np.where(np.any(vectors != 0, axis=-1, keepdims=True), normalised(vectors), 0.0))


def _in_plane(vectors: F64, normals: F64) -> F64:
    height = dot(vectors, normals)[..., None]
    return vectors - normals * height


def _welded(corners: F64, normals: F64, uvs: F64) -> I64:
    """(T, 3) a number for every distinct position, normal and UV."""
    rows = np.concatenate([corners, normals, uvs], axis=2).reshape(-1, 8).astype(np.float32) + np.float32(0)
    keys = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    return np.unique(keys, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)


def _triangle_tangents(corners: F64, uvs: F64) -> tuple[F64, F64, Bools]:
    """Each triangle's unit direction of increasing u, twice its area in UV space, and whether both are defined."""
    d1, d2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    t1, t2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    doubled_area = t1[:, 0] * t2[:, 1] - t1[:, 1] * t2[:, 0]
    along_u: F64 = t2[:, 1:] * d1 - t1[:, 1:] * d2
    along_u[doubled_area <= 0] *= -1
    along_v = -t2[:, :1] * d1 + t1[:, :1] * d2
    tiny = np.finfo(np.float32).tiny
    usable = np.abs(doubled_area) > tiny
    for along in (along_u, along_v):
        usable &= np.linalg.norm(along, axis=1) > tiny
    return _normalised_or_zero(along_u), doubled_area, usable


def _three_places(corners: F64) -> Bools:
    """(T,) whether a triangle's corners are at three distinct positions."""
    rounded = corners.astype(np.float32)
    same: Bools = (rounded == np.roll(rounded, 1, axis=1)).all(axis=2).any(axis=1)
    return ~same


def _meeting_edges(vertex: I64, distinct: Bools) -> I64:
    """(E, 2, 2) flat corner indices of shared edges: an edge's two ends, on either triangle.

    Two triangles share an edge if they traverse it in opposite directions.
    """
    corner = np.arange(vertex.size).reshape(-1, 3)[distinct]
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1).reshape(-1, 2)
    places = vertex.ravel()[ends]
    forward = places[:, 0] < places[:, 1]
    ends = np.where(forward[:, None], ends, ends[:, ::-1])
    low, high = np.sort(places, axis=1).T
    order = np.lexsort((np.arange(len(low)), high, low))
    low, high, forward, ends = low[order], high[order], forward[order], ends[order]
    first = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]) & (forward[1:] != forward[:-1]))
    return np.stack([ends[first], ends[first + 1]], axis=-1)


def _adopted(turns: Bools, usable: Bools, pairs: I64) -> Bools:
    """Orientations, where triangles without UV area adopt that of their first neighbour: groups extend across them."""
    turns, known = turns.copy(), usable.copy()
    triangles = pairs[:, 0] // 3
    both = np.concatenate([triangles, triangles[:, ::-1]])
    while True:
        waiting = both[known[both[:, 0]] & ~known[both[:, 1]]]
        if not len(waiting):
            return turns
        waiting = waiting[np.argsort(-waiting[:, 0], kind="stable")]  # the lowest of several neighbours is written last
        turns[waiting[:, 1]] = turns[waiting[:, 0]]
        known[waiting[:, 1]] = True


def _groups(pairs: I64, turns: Bools) -> I64:
    """(3T,) a number for every set of corners that share one tangent."""
    triangles = pairs[:, 0] // 3
    sharing = pairs[turns[triangles[:, 0]] == turns[triangles[:, 1]]].reshape(-1, 2)
    return connected(3 * len(turns), sharing[:, 0], sharing[:, 1])
