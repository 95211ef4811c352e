"""MikkTSpace tangents of a triangle mesh, as Blender's ``Mesh.calc_tangents`` and other tools compute them.

After Morten S. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008) and his public mikktspace.c, written anew
for NumPy because no maintained Python package carries it on all platforms.
"""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.normals import normalised


def mikktspace_tangents(
    corners: NDArray[np.floating], normals: NDArray[np.floating], uvs: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Tangent and bitangent sign for every corner of every triangle.

    corners: (T, 3, 3) positions. normals: (T, 3, 3) unit shading normals. uvs: (T, 3, 2).
    Returns (T, 3, 4): a unit tangent perpendicular to the corner's normal, then the sign s of B = s N x T.

    Corners that share position, normal and UV, and whose triangles meet at an edge and turn the same way round in UV
    space, share one tangent: the mean of their triangles' tangents, weighted by the triangles' angles there.
    Triangles without area in UV space, which hold no texel, take the tangent of a corner they share, else +x.
    """
    corners, normals, uvs = (np.asarray(a, np.float64) for a in (corners, normals, uvs))
    vertex = _welded(corners, normals, uvs)
    directions, turns, usable = _triangle_tangents(corners, uvs)

    # The triangle's tangent in each corner's own tangent plane, weighted by the triangle's angle there.
    projected = normalised_or_zero(_in_plane(directions[:, None], normals))
    ahead = normalised_or_zero(_in_plane(np.roll(corners, -1, axis=1) - corners, normals))
    behind = normalised_or_zero(_in_plane(np.roll(corners, 1, axis=1) - corners, normals))
    angles = np.arccos(np.clip(np.einsum("tci,tci->tc", ahead, behind), -1, 1))
    weighted = np.where(usable[:, None, None], projected * angles[..., None], 0).reshape(-1, 3)

    group = _groups(vertex, turns, usable)
    count = int(group.max()) + 1
    summed: NDArray[np.float64] = np.stack([np.bincount(group, weighted[:, axis], count) for axis in range(3)], axis=-1)
    tangents = normalised_or_zero(summed)[group]
    signs = np.where(np.repeat(turns, 3), 1.0, -1.0)

    # Corners without a tangent of their own borrow one from a corner at the same welded vertex.
    flat_vertex = vertex.ravel()
    have = np.flatnonzero(np.repeat(usable, 3) & tangents.any(axis=1))
    lender = np.full(int(flat_vertex.max()) + 1, -1)
    lender[flat_vertex[have[::-1]]] = have[::-1]
    need = np.flatnonzero(~(np.repeat(usable, 3) & tangents.any(axis=1)))
    source = lender[flat_vertex[need]]
    tangents[need] = np.where((source >= 0)[:, None], tangents[source], [1.0, 0.0, 0.0])
    signs[need] = np.where(source >= 0, signs[source], signs[need])
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
    along_u = (t2[:, 1:] * d1 - t1[:, 1:] * d2) * np.where(turns, 1.0, -1.0)[:, None]
    along_v = -t2[:, :1] * d1 + t1[:, :1] * d2
    tiny = np.finfo(np.float32).tiny
    usable = (
        (np.abs(doubled_area) > tiny)
        & (np.linalg.norm(along_u, axis=1) > tiny)
        & (np.linalg.norm(along_v, axis=1) > tiny)
        & (np.linalg.norm(np.cross(d1, d2), axis=1) > 0)
    )
    return normalised_or_zero(along_u), turns, usable


def _groups(vertex: NDArray[np.int64], turns: NDArray[np.bool_], usable: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(3T,) a number for every set of corners that share one tangent."""
    corner = np.arange(vertex.size).reshape(-1, 3)
    start, end = vertex, np.roll(vertex, -1, axis=1)
    start_corner, end_corner = corner, np.roll(corner, -1, axis=1)
    edges = np.repeat(usable, 3)
    low, high = np.minimum(start, end).ravel()[edges], np.maximum(start, end).ravel()[edges]
    forward = (start < end).ravel()[edges]
    order = np.lexsort((np.arange(len(low)), high, low))
    low, high, forward = low[order], high[order], forward[order]
    starts, ends = start_corner.ravel()[edges][order], end_corner.ravel()[edges][order]
    # Two triangles meet at an edge when they run along it in opposite directions.
    pair = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]) & (forward[1:] != forward[:-1]))
    same_turn = turns[starts[pair] // 3] == turns[starts[pair + 1] // 3]
    pair = pair[same_turn]
    a = np.concatenate([starts[pair], ends[pair]])
    b = np.concatenate([ends[pair + 1], starts[pair + 1]])
    return _connected(vertex.size, a, b)


def _connected(count: int, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) the least number in each one's connected component, given the edges a - b."""
    label = np.arange(count)
    while True:
        least = np.minimum(label[a], label[b])
        if (label[a] == least).all() and (label[b] == least).all():
            return label
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
        label = label[label]
