"""Dot products, unit vectors and the angles between them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.types import F32, F64

# Vectors of single precision that are shorter than this have no direction.
SHORTEST = 1e-12
# Those of double precision: the areas of a mesh's faces are far smaller in kilometres than in millimetres.
SHORTEST_DOUBLE = 1e-150


def dot(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Dot products (...) of vectors (..., K), whose shapes broadcast. Those of float32 are computed in float32."""
    return np.einsum("...i,...i->...", one, other)


def normalised(vectors: NDArray[Any]) -> NDArray[Any]:
    """Vectors (..., 3) scaled to unit length, in the same floating type. Zero vectors become +z, never NaN.

    >>> normalised(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]])).tolist()
    [[0.6, 0.0, 0.8], [0.0, 0.0, 1.0]]
    """
    length, shortest = np.sqrt(dot(vectors, vectors)), SHORTEST_DOUBLE if vectors.dtype == np.float64 else SHORTEST
    unit: NDArray[Any] = vectors / np.maximum(length, vectors.dtype.type(shortest))[..., None]
    unit[length <= shortest] = (0, 0, 1)
    return unit


def transformed(matrix: F32, vectors: F32) -> F32:
    """(M, N) a matrix (M, 3) times vectors (3, N). A column's result does not depend on the number of columns.

    With BLAS it would: few columns, and the last ones, take other code paths with other rounding.
    """
    return np.einsum("mi,in->mn", matrix, vectors)


def angular_error(estimate: ArrayLike, truth: ArrayLike) -> F64:
    """Angle between unit vectors, by the half-angle formula of Kahan: arccos loses its digits near 0° and 180°.

    Parameters
    ----------
    estimate, truth : (..., 3) array_like
        Unit vectors, all in one frame; their shapes broadcast.

    Returns
    -------
    (...) float64 array
        Degrees, 0 to 180.

    Notes
    -----
    W. Kahan, "How Futile are Mindless Assessments of Roundoff in Floating-Point Computation?" (2006), section 12.

    Examples
    --------
    >>> angular_error([[0, 0, 1], [0, 0, 1]], [[0, 0, -1], [1, 0, 0]]).tolist()
    [180.0, 90.0]
    """
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    angle: F64 = 2 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    return np.degrees(angle)


# ----------------------------------------------------------------------------------------------------------------------
# Rotations as rotation vectors (axis times angle in radians), matrices and quaternions.


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
    return np.eye(3) + first * matrix + second * (matrix @ matrix)


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
    return (vectors + sine * across + versine * np.cross(turns, across)).astype(np.float32)


def rotation_between(start: F32, end: F32) -> F32:
    """(N, 3) the shortest rotation, as a vector, that carries unit vectors `start` (N, 3) to `end` (N, 3)."""
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, dot(start, end))
    return (axis * (angle / np.maximum(sine, 1e-9))[:, None]).astype(np.float32)
