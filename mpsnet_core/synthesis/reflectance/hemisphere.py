"""Evaluate a reflectance for pairs of directions above the surface, in blocks."""

from abc import ABC, abstractmethod

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Floats
from mpsnet_core.arrays.unit_vectors import dot


def rusinkiewicz_angles(normals: Floats, lights: Floats, views: Floats) -> tuple[Floats, Floats, Floats]:
    """Half angle, difference angle and difference azimuth, (N,) radians each, of unit vectors (N, 3).

    theta_half: 0 to pi/2, between the normal and the half vector. theta_difference: 0 to pi/2, between the half vector
    and the light. phi_difference: -pi to pi, the light's azimuth about the half vector, 0 if the light is in the plane
    of normal and half vector, on the side away from the normal. Adding pi swaps light and viewer.

    Accurate near the poles: no angle is computed as the arc cosine of a value near 1.
    """
    towards = lights + views
    apart = lights - views
    length = np.sqrt(dot(towards, towards))
    off_normal = normals - towards / np.maximum(length, np.finfo(length.dtype).tiny)[:, None]
    theta_half = 2 * np.arcsin(np.minimum(np.sqrt(dot(off_normal, off_normal)) / 2, 1))
    theta_difference = np.arctan2(np.sqrt(dot(apart, apart)), length)
    # With half vector h: l - v in the frame whose pole is h, both components times sin(theta_half).
    across = 2 * dot(normals, np.cross(views, lights))
    along = -length * dot(normals, apart)
    return theta_half, theta_difference, np.arctan2(across, along)


# Points processed at a time: their data stays in a core's cache, which is twice as fast.
BLOCK = 1 << 14


class AboveSurface(ABC):
    """A ``Reflectance`` that is 0 unless light and viewer are above the surface."""

    def __call__(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None = None) -> F32:
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
    def _evaluate(self, normals: F32, lights: F32, views: F32, paint: F32 | None) -> F32:
        """(n, 3) reflectance of a block of points (n, 3), all above the surface."""
