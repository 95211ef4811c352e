"""Evaluate a reflectance for pairs of directions above the surface, in blocks."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import dot

# Points processed at a time: their data stays in a core's cache, which is twice as fast.
BLOCK = 1 << 14

Floats = NDArray[np.float32]


class AboveSurface(ABC):
    """A ``Reflectance`` that is 0 unless light and viewer are above the surface."""

    def __call__(
        self,
        normals: NDArray[np.floating[Any]],
        lights: NDArray[np.floating[Any]],
        views: NDArray[np.floating[Any]],
        paint: NDArray[np.floating[Any]] | None = None,
    ) -> NDArray[np.float32]:
        """(N, 3) reflectance where light and viewer are both above the surface, and 0 elsewhere.

        normals, lights, views, paint: (N, 3). Zero or NaN vectors count as below the surface.
        """
        result = np.zeros((len(normals), 3), np.float32)
        for block in bands(len(normals), BLOCK):
            normal, light, view = (np.asarray(vectors[block], np.float32) for vectors in (normals, lights, views))
            factor = None if paint is None else np.maximum(np.asarray(paint[block], np.float32), 0)
            above = (dot(normal, light) > 0) & (dot(normal, view) > 0)
            if above.all():
                result[block] = self._evaluate(normal, light, view, factor)
            elif above.any():
                factor = None if factor is None else factor[above]
                result[block][above] = self._evaluate(normal[above], light[above], view[above], factor)
        return result

    @abstractmethod
    def _evaluate(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None) -> Floats:
        """(n, 3) reflectance of a block of points (n, 3), all above the surface."""
