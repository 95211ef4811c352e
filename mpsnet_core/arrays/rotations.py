"""Rotations as rotation vectors (axis times angle in radians), matrices and quaternions."""

from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.arrays.unit_vectors import dot


def cross_matrix(vectors: F64) -> F64:
    """(..., 3, 3) matrices of the cross product with vectors (..., 3) on the left."""
    matrix = np.zeros((*vectors.shape, 3))
    for i, j, k, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        matrix[..., i, j] = sign * vectors[..., k]
        matrix[..., j, i] = -sign * vectors[..., k]
    return matrix


def rotation_matrices(vectors: F64) -> F64:
    """(K, 3, 3) rotations by rotation vectors (K, 3) (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    matrix = cross_matrix(vectors)
    safe = np.where(angle > 1e-12, angle, 1.0)
    first = np.where(angle > 1e-12, np.sin(angle) / safe, 1.0)
    second = np.where(angle > 1e-12, (1 - np.cos(angle)) / safe**2, 0.5)
    found: F64 = np.eye(3) + first * matrix + second * (matrix @ matrix)
    return found


def quaternion_matrix(w: Any, x: Any, y: Any, z: Any) -> list[list[Any]]:
    """The rows of the rotation matrix of a unit quaternion. Its components may be arrays."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


def rotated(vectors: F32, turns: F32) -> F32:
    """Vectors (..., 3) rotated by rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.sqrt(dot(turns, turns))[..., None]
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    across = np.cross(turns, vectors)
    result: F32 = (vectors + sine * across + versine * np.cross(turns, across)).astype(np.float32)
    return result


def rotation_between(start: F32, end: F32) -> F32:
    """(N, 3) the shortest rotation, as a vector, that carries unit vectors `start` (N, 3) to `end` (N, 3)."""
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, dot(start, end))
    result: F32 = (axis * (angle / np.maximum(sine, 1e-9))[:, None]).astype(np.float32)
    return result
