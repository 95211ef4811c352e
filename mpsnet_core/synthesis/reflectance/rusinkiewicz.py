"""Half and difference angles, the parametrisation of measured isotropic reflectance.

Rusinkiewicz, "A New Change of Variables for Efficient BRDF Representation", Rendering Workshop 1998.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import dot


def rusinkiewicz_angles(
    normals: NDArray[np.floating[Any]], lights: NDArray[np.floating[Any]], views: NDArray[np.floating[Any]]
) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]], NDArray[np.floating[Any]]]:
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
