"""Where a reflectance is asked: pairs of directions above the surface, a block of them at a time."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Points worked on at once: what they need stays in a core's own cache, which is worth a factor of two.
BLOCK = 1 << 14

# normals (n, 3), lights (n, 3), views (n, 3), paint (n, 3) or None -> (n, 3), float32
Evaluate = Callable[
    [NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32] | None], NDArray[np.float32]
]


def above_surface(
    evaluate: Evaluate, normals: NDArray[Any], lights: NDArray[Any], views: NDArray[Any], paint: NDArray[Any] | None
) -> NDArray[np.float32]:
    """What `evaluate` gives where the light and the viewer are both above the surface, and 0 elsewhere.

    normals, lights, views, paint: (N, 3); a vector that is zero or not a number counts as below. Returns (N, 3).
    """
    result = np.zeros((len(normals), 3), np.float32)
    for start in range(0, len(normals), BLOCK):
        block = slice(start, start + BLOCK)
        normal, light, view = (np.asarray(vectors[block], np.float32) for vectors in (normals, lights, views))
        factor = None if paint is None else np.maximum(np.asarray(paint[block], np.float32), 0)
        above = (dot(normal, light) > 0) & (dot(normal, view) > 0)
        if above.all():
            result[block] = evaluate(normal, light, view, factor)
        elif above.any():
            factor = None if factor is None else factor[above]
            result[block][above] = evaluate(normal[above], light[above], view[above], factor)
    return result


def dot(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Dot products (N,) of vectors (N, 3)."""
    return np.einsum("ij,ij->i", a, b)
