"""MikkTSpace tangents of a triangle mesh, as Blender's ``Mesh.calc_tangents`` and other tools compute them.

After Morten S. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008) and his public mikktspace.c, written anew
for NumPy because no maintained Python package carries it on all platforms.
"""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.connected import connected
from mpsnet_core.normals import normalised


def mikktspace_tangents(
    corners: NDArray[np.floating], normals: NDArray[np.floating], uvs: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Tangent and bitangent sign for every corner of every triangle.

    corners: (T, 3, 3) positions. normals: (T, 3, 3) unit shading normals. uvs: (T, 3, 2).
    Returns (T, 3, 4): a unit tangent perpendicular to the corner's normal, then the sign s of B = s N x T.

    Corners that share position, normal and UV, and whose triangles meet at an edge and turn the same way round in UV
    space, share one tangent: the mean of their triangles' tangents, weighted by the triangles' angles there.
    Triangles without area in UV space, which hold no texel, belong to their neighbours' groups; a corner that no group
    gives a tangent takes one from a corner at the same vertex, else +x. mikktspace.c leaves zero at the few corners
    whose angle is too small for single precision (about 5e-4 rad); here they have the unit tangent.
    """
    corners, normals, uvs = (np.asarray(a, np.float64) for a in (corners, normals, uvs))
    vertex = _welded(corners, normals, uvs)
    directions, turns, usable = _triangle_tangents(corners, uvs)
    distinct = _three_places(corners)
    usable &= distinct
    pairs = _meeting_edges(vertex, distinct)
    turns = _adopted(turns, usable, pairs)

    # The triangle's tangent in each corner's own tangent plane, weighted by the triangle's angle there.
    projected = normalised_or_zero(_in_plane(directions[:, None], normals))
    ahead = normalised_or_zero(_in_plane(np.roll(corners, -1, axis=1) - corners, normals))
    behind = normalised_or_zero(_in_plane(np.roll(corners, 1, axis=1) - corners, normals))
    angles = np.arccos(np.clip(np.einsum("tci,tci->tc", ahead, behind), -1, 1))
    weighted = np.where(usable[:, None, None], projected * angles[..., None], 0).reshape(-1, 3)

    group = _groups(pairs, turns)
    count = int(group.max()) + 1
    summed: NDArray[np.float64] = np.stack([np.bincount(group, weighted[:, axis], count) for axis in range(3)], axis=-1)
    tangents = normalised_or_zero(summed)[group]
    signs = np.where(np.repeat(turns, 3), 1.0, -1.0)

    # Corners without a tangent of their own borrow one from a corner at the same welded vertex.
    flat_vertex = vertex.ravel()
    has_tangent = tangents.any(axis=1)
    have = np.flatnonzero(has_tangent)
    lender = np.full(int(flat_vertex.max()) + 1, -1)
    lender[flat_vertex[have[::-1]]] = have[::-1]
    need = np.flatnonzero(~has_tangent)
    source = lender[flat_vertex[need]]
    tangents[need] = np.where((source >= 0)[:, None], tangents[source], [1.0, 0.0, 0.0])
    signs[need] = np.where(source >= 0, signs[source], -1.0)
    return np.concatenate([tangents, signs[:, None]], axis=1).reshape(-1, 3, 4).astype(np.float32)


def normalised_or_zero(vectors: NDArray[np.floating]) -> NDArray[np.floating]:
    """Vectors (..., 3) brought to unit length; those without a direction stay zero."""
    return np.asarray(np.where(np.any(vectors != 0, axis=-1, keepdims=True), normalised(vectors), 0.0))


def _in_plane(vectors: NDArray[np.floating], normals: NDArray[np.floating]) -> NDArray[np.floating]:
    return vectors - normals * np.einsum("tci,tci->tc", np.broadcast_to(vectors, normals.shape), normals)[..., None]


def _welded(
    corners: NDArray[np.floating], normals: NDArray[np.floating], uvs: NDArray[np.floating]
) -> NDArray[np.int64]:
    """(T, 3) a number for every distinct position, normal and UV."""
    rows = np.concatenate([corners, normals, uvs], axis=2).reshape(-1, 8).astype(np.float32) + np.float32(0)
    keys = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    return np.unique(keys, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)


def _triangle_tangents(
    corners: NDArray[np.floating], uvs: NDArray[np.floating]
) -> tuple[NDArray[np.floating], NDArray[np.bool_], NDArray[np.bool_]]:
    """Each triangle's unit direction of growing u, whether its UVs turn counter-clockwise, and whether it has both."""
    d1, d2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    t1, t2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    doubled_area = t1[:, 0] * t2[:, 1] - t1[:, 1] * t2[:, 0]
    turns = doubled_area > 0
    along_u: NDArray[np.floating] = t2[:, 1:] * d1 - t1[:, 1:] * d2
    along_u[~turns] *= -1
    along_v = -t2[:, :1] * d1 + t1[:, :1] * d2
    tiny = np.finfo(np.float32).tiny
    usable = (
        (np.abs(doubled_area) > tiny)
        & (np.linalg.norm(along_u, axis=1) > tiny)
        & (np.linalg.norm(along_v, axis=1) > tiny)
    )
    return normalised_or_zero(along_u), turns, usable


def _three_places(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(T,) whether no two of a triangle's corners stand at one place."""
    rounded = corners.astype(np.float32)
    same: NDArray[np.bool_] = (rounded == np.roll(rounded, 1, axis=1)).all(axis=2).any(axis=1)
    return ~same


def _meeting_edges(vertex: NDArray[np.int64], distinct: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(E, 2, 2) corners, numbered through, where two triangles meet: their edge's two ends, on either triangle.

    They meet where they run along the edge in opposite directions.
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


def _adopted(turns: NDArray[np.bool_], usable: NDArray[np.bool_], pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Triangles without UV area turn as the first neighbour does, so that groups reach across them."""
    turns, known = turns.copy(), usable.copy()
    triangles = pairs[:, 0] // 3
    both = np.concatenate([triangles, triangles[:, ::-1]])
    while True:
        waiting = both[known[both[:, 0]] & ~known[both[:, 1]]]
        if not len(waiting):
            return turns
        waiting = waiting[np.argsort(-waiting[:, 0], kind="stable")]  # where several offer, the least number stays
        turns[waiting[:, 1]] = turns[waiting[:, 0]]
        known[waiting[:, 1]] = True


def _groups(pairs: NDArray[np.int64], turns: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(3T,) a number for every set of corners that share one tangent."""
    triangles = pairs[:, 0] // 3
    sharing = pairs[turns[triangles[:, 0]] == turns[triangles[:, 1]]].reshape(-1, 2)
    return connected(3 * len(turns), sharing[:, 0], sharing[:, 1])
