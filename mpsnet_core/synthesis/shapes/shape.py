"""The shape: a closed triangle mesh with shading normals and numbered parts; transform, join and normalise shapes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.types import F32, F64, I32, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.scene.mesh import triangle_normals


@dataclass(frozen=True)
class Shape:
    """A triangle mesh in object space: centred at the origin, z up, bounding sphere of radius 1."""

    vertices: F64
    """(V, 3) float64. Positions."""
    triangles: I32
    """(T, 3) int32. Vertex indices, counter-clockwise seen from outside."""
    corner_normals: F32
    """(T, 3, 3) float32. Unit shading normals."""
    parts: I32
    """(T,) int32. The part that each triangle belongs to."""


def smooth_shape(vertices: F64, triangles: I32, normals: Floats | None = None) -> Shape:
    """A shape of one part with normals (V, 3) per vertex, by default those of its triangles, weighted by area."""
    if normals is None:
        faces = triangle_normals(vertices[triangles])
        summed = [np.bincount(triangles.ravel(), np.repeat(faces[:, axis], 3), len(vertices)) for axis in range(3)]
        normals = normalised(np.stack(summed, axis=1))
    return Shape(vertices, triangles, normals.astype(np.float32)[triangles], np.zeros(len(triangles), np.int32))


def faceted_shape(vertices: F64, triangles: I32) -> Shape:
    """A flat-shaded shape of one part."""
    faces = normalised(triangle_normals(vertices[triangles])).astype(np.float32)
    return Shape(vertices, triangles, np.repeat(faces[:, None], 3, axis=1), np.zeros(len(triangles), np.int32))


def vertex_normals(shape: Shape) -> F64:
    """(V, 3) normals of a shape with one normal per vertex."""
    normals = np.zeros_like(shape.vertices)
    normals[shape.triangles.ravel()] = shape.corner_normals.reshape(-1, 3)
    return normals


def joined(shapes: Sequence[Shape]) -> Shape:
    """Join shapes, which may intersect, into one; each becomes a part."""
    starts = np.cumsum([0] + [len(shape.vertices) for shape in shapes[:-1]])
    return Shape(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.triangles + np.int32(s) for shape, s in zip(shapes, starts, strict=True)]),
        np.concatenate([shape.corner_normals for shape in shapes]),
        np.repeat(np.arange(len(shapes), dtype=np.int32), [len(shape.triangles) for shape in shapes]),
    )


def placed(shape: Shape, axes: ArrayLike | None = None, scale: float = 1.0, offset: ArrayLike = (0, 0, 0)) -> Shape:
    """Rotate a shape so that its x, y and z axes become the rows of `axes`, scale it, then move it by `offset`."""
    turn = np.eye(3) if axes is None else np.asarray(axes, np.float64)
    return replace(
        shape,
        vertices=shape.vertices @ turn * scale + np.asarray(offset, np.float64),
        corner_normals=(shape.corner_normals.reshape(-1, 3) @ turn).astype(np.float32).reshape(-1, 3, 3),
    )


def standing(shape: Shape) -> Shape:
    """Move a shape so that its lowest point is at z = 0."""
    return placed(shape, offset=(0, 0, -shape.vertices[:, 2].min()))


def fitted(shape: Shape) -> Shape:
    """Move and scale a shape to a bounding sphere of radius 1 around the centre of its bounding box."""
    vertices = shape.vertices - (shape.vertices.min(axis=0) + shape.vertices.max(axis=0)) / 2
    vertices /= np.sqrt((vertices**2).sum(axis=1).max())
    return replace(shape, vertices=vertices)


def turn_about(axis: ArrayLike, degrees: float) -> F64:
    """Axes for :func:`placed` that rotate a shape by `degrees` about `axis`, counter-clockwise seen from its tip."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: F64 = np.eye(3) + sin * across + (1 - cos) * (across @ across)
    return turn.T


# --- Parametric surfaces: closed meshes from rings and grids, curves, and deformations of meshes with their normals


# Step of the finite differences along the surface for normals of displaced vertices.
_STEP = 1e-3


def stacked(rings: F64) -> Shape:
    """A closed surface through a stack of rings (M, N, 3), counter-clockwise seen from the side of the last one."""
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
    return smooth_shape(vertices, np.concatenate([sides, caps]))


def slab(outline: F64, height: float, bevel: float) -> Shape:
    """A bevelled plate from z = 0 to `height`. outline: (N, 2), counter-clockwise, star-shaped about the origin.

    The radius of its corners must be larger than the bevel.
    """
    ahead = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    outward = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-12)[:, None]
    turns = np.linspace(0, np.pi / 2, 5)
    inset = bevel * (1 - np.sin(turns))
    low = [(i, bevel * (1 - np.cos(t))) for i, t in zip(inset, turns, strict=True)]
    steps = [*low, *((i, height - z) for i, z in reversed(low))]
    rings = [np.column_stack([outline - i * outward, np.full(len(outline), z)]) for i, z in steps]
    # Rings inside both faces, close to the bevels, keep the faces' shading flat.
    rings = [rings[0] * (0.9, 0.9, 1), *rings, rings[-1] * (0.9, 0.9, 1)]
    return stacked(np.stack(rings))


def sheet(front: F64, back: F64) -> Shape:
    """A closed sheet between two grids (M, N, 3), with a round hem.

    Seen from the front, rows run down and columns to the right.
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
    return smooth_shape(np.concatenate([flat, back.reshape(-1, 3), *hems]), triangles)


def displaced(shape: Shape, height: Callable[[F64], Floats]) -> Shape:
    """Displace a smooth shape of one part along its normals by a height field in space, (N, 3) to (N,).

    Normals follow the gradient of the field along the surface.
    """
    normals = vertex_normals(shape)
    side = normalised(np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)]))
    other = np.cross(normals, side)
    here = np.asarray(height(shape.vertices), np.float64)
    gradient = [
        (height(shape.vertices + _STEP * tangent) - height(shape.vertices - _STEP * tangent)) / (2 * _STEP)
        for tangent in (side, other)
    ]
    tilted = normalised(normals - gradient[0][:, None] * side - gradient[1][:, None] * other)
    return smooth_shape(shape.vertices + here[:, None] * normals, shape.triangles, tilted)


def bent(shape: Shape, bend: Callable[[F64], F64]) -> Shape:
    """Deform a shape and its normals by a smooth map of space, (N, 3) to (N, 3)."""
    moved = bend(shape.vertices)
    x, y, z = ((bend(shape.vertices + step) - moved) / _STEP for step in _STEP * np.eye(3))
    # Normals transform by the cofactor matrix of the map's Jacobian.
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1).astype(np.float32)
    normals = normalised(np.einsum("tck,tcki->tci", shape.corner_normals, cofactors[shape.triangles]))
    return replace(shape, vertices=moved, corner_normals=normals)


def catmull_rom(knots: F64, nodes: int) -> F64:
    """(nodes, ...) points, evenly spaced in parameter, on the Catmull-Rom spline (1974) through knots (M, ...)."""
    place = np.linspace(0, len(knots) - 1, nodes)
    start = np.minimum(place.astype(np.int64), len(knots) - 2)
    t = (place - start).reshape(-1, *[1] * (knots.ndim - 1))
    padded = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    a, b, c, d = (padded[start + k] for k in range(4))
    return 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)


@lru_cache(maxsize=4)
def sphere(level: int) -> tuple[F64, I32]:
    """Vertices and triangles of the unit sphere: an icosahedron subdivided `level` times."""
    from trimesh.creation import icosphere  # slow to import

    ball = icosphere(level)
    return np.array(ball.vertices), ball.faces.astype(np.int32)
