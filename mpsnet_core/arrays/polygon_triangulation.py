"""Triangulation of polygons: fans, and ear clipping for concave ones; triangle strips."""

from itertools import pairwise

import numpy as np

from mpsnet_core.arrays.types import F64, I64, Bools
from mpsnet_core.arrays.unit_vectors import dot

# Pairs of corners that ear clipping tests at once: few enough to stay in a CPU core's cache.
CORNERS_AT_ONCE = 1 << 15


def strip_triangles(strip: I64) -> I64:
    """(T, 3) the triangles of a strip of vertices (N,), all of one orientation. A negative number ends a strip.

    Triangles with a repeated vertex, which only lead from one part of a strip to the next, are left out.

    >>> strip_triangles(np.array([0, 1, 2, 3, -1, 4, 5, 6])).tolist()
    [[0, 1, 2], [1, 3, 2], [4, 5, 6]]
    """
    place = np.arange(len(strip))
    begun = np.maximum.accumulate(np.where(strip < 0, place + 1, 0))
    first = place[: max(len(strip) - 2, 0)]
    odd = (first - begun[first]) % 2
    triangles = strip[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]
    a, b, c = triangles.T
    kept: Bools = (triangles >= 0).all(axis=1) & (a != b) & (b != c) & (c != a)
    return np.compress(kept, triangles, axis=0)


def triangulated(places: F64, sizes: I64) -> I64:
    """(T, 3) corner indices of the triangulated polygons, in the polygons' order.

    places: (C, 3) positions of the corners, polygon after polygon. sizes: (F,) corners per polygon. Concave polygons
    are triangulated by ear clipping, convex ones as a fan.
    """
    ends = np.cumsum(sizes)
    starts, polygon = ends - sizes, np.repeat(np.arange(len(sizes)), sizes)
    is_second = np.ones(len(places), bool)
    is_second[starts] = is_second[ends - 1] = False
    second = np.flatnonzero(is_second)
    triangles: I64 = np.stack([starts[polygon[second]], second, second + 1], axis=1)

    ahead, behind = np.arange(len(places)) + 1, np.arange(len(places)) - 1
    ahead[ends - 1], behind[starts] = starts, ends - 1
    around = places - places[starts][polygon]
    normals = np.add.reduceat(np.cross(around, around[ahead]), starts)
    turns = np.cross(places - places[behind], places[ahead] - places)
    inwards = dot(turns, normals[polygon])
    notched = np.unique(polygon[inwards < 0])
    for number in notched:
        start, end = starts[number], ends[number]
        first = start - 2 * number  # each polygon before it has two triangles fewer than corners
        triangles[first : first + sizes[number] - 2] = start + _cut_ears(around[start:end], normals[number])
    return triangles


def _cut_ears(places: F64, normal: F64) -> I64:
    """(N - 2, 3) triangles of one polygon (N, 3) by ear clipping, seen along its normal.

    An ear is a convex corner whose triangle with its two neighbours contains no other corner. Each round cuts off all
    ears, but only one of two adjacent ones. Without ears, as in a self-intersecting polygon, the rest becomes a fan.
    """
    along = int(np.argmax(np.abs(normal)))
    flat = places[:, [(along + 1) % 3, (along + 2) % 3]] * [1, np.sign(normal[along])]

    def doubled_area(a: F64, b: F64, c: F64) -> F64:
        (x, y), (to_x, to_y) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        return x * to_y - y * to_x

    def is_free(triangles: F64, others: F64) -> Bools:
        """(E,) whether no other corner (O, 2) is in a triangle (E, 3, 2)."""
        behind, ear, ahead = np.moveaxis(triangles[:, None], 2, 0)
        within = np.ones((len(triangles), len(others)), bool)
        for a, b in ((behind, ear), (ear, ahead), (ahead, behind)):
            within &= doubled_area(a, b, others) >= 0
            within &= (others != a).any(axis=-1)  # a point may occur twice, where a bridge edge leads to a hole
        return ~within.any(axis=1)

    left, triangles = np.arange(len(flat)), []
    is_ear, changed = np.zeros(len(flat), bool), left  # a cut changes its two neighbours alone
    while len(left) > 3:
        around = np.stack([np.roll(left, 1), left, np.roll(left, -1)], axis=1)
        outwards = doubled_area(*np.moveaxis(flat[around], 1, 0)) > 0
        others = flat[left[~outwards]]  # if a triangle contains any corner, then a reflex one
        is_ear[changed] = False
        maybe = np.searchsorted(left, changed)
        maybe = maybe[outwards[maybe]]
        for some in np.array_split(maybe, 1 + len(maybe) * len(others) // CORNERS_AT_ONCE):
            is_ear[left[some]] = is_free(flat[around[some]], others)
        cut: list[int] = []
        for place in map(int, np.flatnonzero(is_ear[left])):
            if not cut or (place - cut[-1] > 1 and place - cut[0] < len(left) - 1):
                cut.append(place)
        if not cut:
            break
        cut = cut[: len(left) - 3]
        triangles += np.sort(around[cut], axis=1).tolist()
        changed = np.setdiff1d(around[cut][:, [0, 2]], left[cut])
        left = np.delete(left, cut)
    triangles += [[int(left[0]), *map(int, pair)] for pair in pairwise(left[1:])]
    return np.array(sorted(triangles))
