"""Surfaces: closed meshes swept, turned and folded from curves and grids, and fine relief on any of them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.shapes.shape import Shape, smooth_shape, vertex_normals

Array = NDArray[np.float64]
# Step of the differences along the surface that tilt the normals of displaced vertices.
_STEP = 1e-3


def stacked(rings: Array, part: int = 0) -> Shape:
    """A closed surface through a stack of rings (M, N, 3), each counter-clockwise seen from the last one's side."""
    layers, around = rings.shape[:2]
    ends = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
    here = np.arange(around, dtype=np.int32)
    after = (here + 1) % around
    first, last = np.full(around, layers * around, np.int32), np.full(around, layers * around + 1, np.int32)
    top = (layers - 1) * around
    starts = np.arange(layers - 1, dtype=np.int32)[:, None] * around
    a, b = starts + here, starts + after
    sides = np.stack([a, b, b + around, a, b + around, a + around], axis=-1).reshape(-1, 3)
    caps = np.concatenate([np.stack([first, after, here], axis=1), np.stack([last, top + here, top + after], axis=1)])
    vertices = np.concatenate([rings.reshape(-1, 3), ends])
    return smooth_shape(vertices, np.concatenate([sides, caps]), parts=part)


def turned_profile(profile: ArrayLike, part: int = 0, around: int = 72) -> Shape:
    """A surface of revolution about z: profile (M, 2) of radius and height, from its lower to its upper end.

    The profile may run back down inside, as that of a bowl does.
    """
    profile = np.asarray(profile, np.float64)
    angles = np.arange(around) * (2 * np.pi / around)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rings = np.empty((len(profile), around, 3))
    rings[..., :2] = profile[:, None, :1] * circle
    rings[..., 2] = profile[:, None, 1]
    return stacked(rings, part)


def tube(path: ArrayLike, radii: ArrayLike, part: int = 0, around: int = 20) -> Shape:
    """A tube of `radii` (M,) along a curve (M, 3), with rounded ends: handles, straps, ropes, branches."""
    curve = np.asarray(path, np.float64)
    thick = np.broadcast_to(np.asarray(radii, np.float64), len(curve))
    along = normalised(np.gradient(curve, axis=0))
    # A frame that does not twist: each is the one before, turned the shortest way.
    side = np.cross(along[0], np.eye(3)[np.abs(along[0]).argmin()])
    frames = []
    for tangent in along:
        side = side - (side @ tangent) * tangent
        side = side / np.linalg.norm(side)
        frames.append((side, np.cross(tangent, side)))
    angles = np.arange(around) * (2 * np.pi / around)
    cap = np.linspace(0.05, np.pi / 2, 5)[:-1]
    # Rounded ends: more rings at either end, smaller and farther out.
    ends = [(0, np.sin(c), -np.cos(c)) for c in cap]
    body = [(k, 1.0, 0.0) for k in range(len(curve))]
    other = [(len(curve) - 1, np.sin(c), np.cos(c)) for c in cap[::-1]]
    rings = []
    for k, wide, out in [*ends, *body, *other]:
        u, v = frames[k]
        centre = curve[k] + out * thick[k] * along[k]
        rings.append(centre + wide * thick[k] * (np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v))
    return stacked(np.stack(rings), part)


def slab(outline: ArrayLike, height: float, bevel: float, part: int = 0) -> Shape:
    """A star-shaped outline (N, 2) about the origin, counter-clockwise, as a plate from z = 0 to `height`.

    Its corners must be rounder than the bevel.
    """
    flat = np.asarray(outline, np.float64)
    ahead = np.roll(flat, -1, axis=0) - np.roll(flat, 1, axis=0)
    outward = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-12)[:, None]
    turns = np.linspace(0, np.pi / 2, 5)
    inset = bevel * (1 - np.sin(turns))
    low = [(i, bevel * (1 - np.cos(t))) for i, t in zip(inset, turns, strict=True)]
    steps = [*low, *((i, height - z) for i, z in reversed(low))]
    rings = [np.column_stack([flat - i * outward, np.full(len(flat), z)]) for i, z in steps]
    # Rings inside the two faces, close to their bevels, keep the faces' shading flat.
    rings = [rings[0] * (0.9, 0.9, 1), *rings, rings[-1] * (0.9, 0.9, 1)]
    return stacked(np.stack(rings), part)


def sheet(front: Array, back: Array, part: int = 0) -> Shape:
    """A closed sheet between two grids (M, N, 3), with a round hem.

    Seen from the front, the first index runs down and the second to the right.
    """
    rows, columns = front.shape[:2]
    number = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    other = rows * columns
    rim = np.concatenate([number[:, 0], number[-1, 1:], number[-2::-1, -1], number[0, -2:0:-1]])
    inner = np.concatenate([number[:, 1], number[-2, 1:], number[-2::-1, -2], number[1, -2:0:-1]])
    flat = front.reshape(-1, 3)
    edge, behind = flat[rim], back.reshape(-1, 3)[rim]
    outward = normalised(edge - flat[inner])
    middle, half = (edge + behind) / 2, (edge - behind) / 2
    wide = np.minimum(np.linalg.norm(half, axis=1), 2 * np.linalg.norm(edge - flat[inner], axis=1).mean())[:, None]
    hems = [middle + np.cos(t) * half + np.sin(t) * wide * outward for t in np.radians((45, 90, 135))]
    loops = [rim, *(2 * other + len(rim) * k + np.arange(len(rim), dtype=np.int32) for k in range(3)), rim + other]
    strips = []
    for near, far in pairwise(loops):
        after, beyond = np.roll(near, -1), np.roll(far, -1)
        strips.append(np.stack([near, far, beyond, near, beyond, after], axis=-1).reshape(-1, 3))
    triangles = np.concatenate([faces, faces[:, ::-1] + other, *strips]).astype(np.int32)
    return smooth_shape(np.concatenate([flat, back.reshape(-1, 3), *hems]), triangles, parts=part)


def displaced(shape: Shape, height: Callable[[Array], NDArray[np.floating]]) -> Shape:
    """A smooth shape moved along its normals by a height field in space: points (N, 3) to (N,) heights.

    The normals tilt with the slope of the field along the surface.
    """
    normals = vertex_normals(shape)
    side = normalised(np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)]))
    other = np.cross(normals, side)
    here = np.asarray(height(shape.vertices), np.float64)
    slopes = [
        (height(shape.vertices + _STEP * tangent) - height(shape.vertices - _STEP * tangent)) / (2 * _STEP)
        for tangent in (side, other)
    ]
    tilted = normalised(normals - slopes[0][:, None] * side - slopes[1][:, None] * other)
    return smooth_shape(shape.vertices + here[:, None] * normals, shape.triangles, tilted, shape.parts)


def bent(shape: Shape, bend: Callable[[Array], Array]) -> Shape:
    """A shape whose every point is moved by a smooth map of space, (N, 3) to (N, 3), and its normals with it."""
    moved = bend(shape.vertices)
    x, y, z = ((bend(shape.vertices + step) - moved) / _STEP for step in _STEP * np.eye(3))
    # Normals go with the cofactors of the map's derivative.
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1).astype(np.float32)
    normals = normalised(np.einsum("tck,tcki->tci", shape.corner_normals, cofactors[shape.triangles]))
    return replace(shape, vertices=moved, corner_normals=normals)


def smooth_curve(points: Sequence[ArrayLike] | Array, steps: int) -> Array:
    """Points (M, D) joined by a smooth curve through all of them (Catmull and Rom 1974), `steps` points a stretch."""
    knots = np.asarray(points, np.float64)
    knots = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    t = (np.arange(steps) / steps)[:, None, None]
    a, b, c, d = knots[:-3], knots[1:-2], knots[2:-1], knots[3:]
    curve = 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
    return np.concatenate([curve.transpose(1, 0, 2).reshape(-1, knots.shape[1]), knots[-2:-1]])


def smooth_profile(points: ArrayLike, steps: int = 8) -> Array:
    """A smooth curve through points (M, 2) of radius and height that stays off the axis, for a turned profile."""
    curve = smooth_curve(np.asarray(points, np.float64), steps)
    curve[:, 0] = np.maximum(curve[:, 0], 1e-3)
    return curve


@lru_cache(maxsize=4)
def sphere(level: int) -> tuple[Array, NDArray[np.int32]]:
    """Vertices and triangles of the unit sphere: an icosahedron, each triangle in 4 to the power of `level`."""
    golden = (1 + 5**0.5) / 2
    corners = [(s, t * golden, 0.0) for s in (-1, 1) for t in (-1, 1)]
    vertices = normalised(np.array([np.roll(corner, turn) for turn in range(3) for corner in corners]))
    close = (vertices @ vertices.T) > 0.4
    triangles = np.array(
        [
            (a, b, c)
            for a in range(12)
            for b in range(a)
            for c in range(b)
            if close[a, b] and close[b, c] and close[a, c]
        ]
    )
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    triangles[inward] = triangles[inward, ::-1]
    for _ in range(level):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges[:, 0] * len(vertices) + edges[:, 1], return_inverse=True)
        middle = (index.reshape(-1, 3) + len(vertices)).T
        pairs = np.stack([unique // len(vertices), unique % len(vertices)])
        vertices = np.concatenate([vertices, normalised(vertices[pairs[0]] + vertices[pairs[1]])])
        a, b, c = triangles.T
        ab, bc, ca = middle
        triangles = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
    vertices.flags.writeable = False
    faces = triangles.astype(np.int32)
    faces.flags.writeable = False
    return vertices, faces
