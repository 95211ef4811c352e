"""Relighting: the surface under a white light from any direction, to judge normals by."""

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Floats
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.relief.height_map import check_size
from mpsnet_core.scene.normal_map import NormalMap

# The fraction of ambient light, which ambient occlusion reduces.
AMBIENT = 0.15


@takes_files
def relit(
    normals: NormalMap, direction: ArrayLike, *, occlusion: Floats | None = None, albedo: Floats | None = None
) -> F32:
    """A matt surface under a distant white light, without cast shadows.

    Parameters
    ----------
    normals : NormalMap
        Normals in camera space, (H, W).
    direction : (3,) array_like
        Direction from the surface to the light in camera space, of any length.
    occlusion : (H, W) array, optional
        Ambient occlusion, 0 to 1, from :func:`mpsnet_core.relief.occlusion.ambient_occlusion`; 1 by default.
    albedo : (H, W, 3) array, optional
        Linear albedo; a light grey of 0.8 by default.

    Returns
    -------
    (H, W, 4) float32 array
        sRGB values, and the mask as alpha.

    Raises
    ------
    GeometryError
        If the sizes differ, or the direction is 0 or not finite.

    Notes
    -----
    Linear radiance is ``albedo * ((1 - a) * max(n . l, 0) + a * occlusion)`` with a = 0.15. Lambertian radiance is the
    same in all directions and the light is distant, so a perspective camera makes no difference.
    """
    light = np.asarray(direction, np.float64)
    if light.shape != (3,) or not np.isfinite(light).all() or not light.any():
        raise GeometryError("a light's direction is three finite numbers that are not all 0")
    occlusion, albedo = (None if values is None else np.asarray(values) for values in (occlusion, albedo))
    for what, values in (("ambient occlusion", occlusion), ("albedo", albedo)):
        if values is not None:
            check_size(what, values.shape, normals)
    light = (light / np.linalg.norm(light)).astype(np.float32)
    picture = np.empty((*normals.mask.shape, 4), np.float32)
    for rows in bands(len(picture)):
        shading = (1 - AMBIENT) * np.maximum(normals.vectors[rows] @ light, 0)
        shading += AMBIENT if occlusion is None else AMBIENT * occlusion[rows]
        radiance = shading[..., None] * (np.float32(0.8) if albedo is None else albedo[rows])
        picture[rows, :, :3] = np.where(normals.mask[rows, :, None], linear_to_srgb(radiance), 0)
    picture[..., 3] = normals.mask
    return picture
