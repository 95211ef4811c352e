"""The shape: a closed triangle mesh with shading normals and numbered parts; transform, join and normalise shapes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.scene.mesh import triangle_normals


@dataclass(frozen=True)
class Shape:
    """A triangle mesh in object space: centred at the origin, z up, bounding sphere of radius 1."""

    vertices: NDArray[np.float64]
    """(V, 3) float64. Positions."""
    triangles: NDArray[np.int32]
    """(T, 3) int32. Vertex indices, counter-clockwise seen from outside."""
    corner_normals: NDArray[np.float32]
    """(T, 3, 3) float32. Unit shading normals."""
    parts: NDArray[np.int32]
    """(T,) int32. The part that each triangle belongs to."""


def smooth_shape(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], normals: NDArray[np.floating[Any]] | None = None
) -> Shape:
    """A shape of one part with normals (V, 3) per vertex, by default those of its triangles, weighted by area."""
    if normals is None:
        faces = triangle_normals(vertices[triangles])
        summed = [np.bincount(triangles.ravel(), np.repeat(faces[:, axis], 3), len(vertices)) for axis in range(3)]
        normals = normalised(np.stack(summed, axis=1))
    return Shape(vertices, triangles, normals.astype(np.float32)[triangles], np.zeros(len(triangles), np.int32))


def faceted_shape(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> Shape:
    """A flat-shaded shape of one part."""
    faces = normalised(triangle_normals(vertices[triangles])).astype(np.float32)
    return Shape(vertices, triangles, np.repeat(faces[:, None], 3, axis=1), np.zeros(len(triangles), np.int32))


def vertex_normals(shape: Shape) -> NDArray[np.float64]:
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


def turn_about(axis: ArrayLike, degrees: float) -> NDArray[np.float64]:
    """Axes for :func:`placed` that rotate a shape by `degrees` about `axis`, counter-clockwise seen from its tip."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: NDArray[np.float64] = np.eye(3) + sin * across + (1 - cos) * (across @ across)
    return turn.T
