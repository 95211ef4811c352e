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
    products: NDArray[Any] = np.einsum("...i,...i->...", one, other)
    return products


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
    product: F32 = np.einsum("mi,in->mn", matrix, vectors)
    return product


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
