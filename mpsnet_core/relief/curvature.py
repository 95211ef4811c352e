"""Curvature of a surface from its normals: convex edges are above 0, creases below."""

import numpy as np

from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.defaults import CURVATURE_RADIUS
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.height_map import check_size
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# Quantile of |curvature| that is shown as white or black.
PICTURE_QUANTILE = 0.99
# Pixels that the quantile is computed from.
_SAMPLED = 1_000_000


@takes_files
def curvature(
    normals: NormalMap,
    camera: Camera,
    depth: Floats | None = None,
    *,
    radius: int = CURVATURE_RADIUS,
    progress: Progress = silent,
) -> F32:
    """The sum of the two principal curvatures, which is twice the mean curvature.

    Parameters
    ----------
    normals : NormalMap
        Normals in camera space, (H, W).
    camera : Camera
        The photo's camera.
    depth : (H, W) array, optional
        Depth along the camera's axis. Required for a perspective camera.
    radius : int
        Averages over squares of 1, 2, 4, ... up to `radius` pixels around each pixel are weighted by their radius, to
        keep broad shapes visible under fine grain. 0 takes the curvature of each pixel, from its neighbours.
    progress : Progress

    Returns
    -------
    (H, W) float32 array
        In 1 / the camera's unit, above 0 where the surface is convex: 2 / R on a sphere of radius R, 1 / R on a
        cylinder, at any slant. 0 outside the mask.

    Raises
    ------
    GeometryError
        If the sizes differ or a depth is missing.
    SettingsError
        If the radius is below 0.

    Notes
    -----
    It is the divergence of the normal field in space, with normals constant along each pixel's ray. Depth
    discontinuities that the normals do not show have no curvature.
    """
    height, width = normals.mask.shape
    check_size("camera", (camera.height, camera.width), normals)
    perspective = camera.projection == "perspective"
    if perspective and (depth is None or np.shape(depth) != (height, width)):
        raise GeometryError("the curvature under a perspective camera needs the depth of every pixel")
    check_curvature(radius)
    depth = None if depth is None else np.asarray(depth)
    sharp = np.zeros((height, width), np.float32)
    for rows in bands(height):
        progress(0.5 * rows.start / height, "curvature")
        sharp[rows] = _divergence(normals, camera, depth if perspective else None, rows)
    if radius == 0:
        return sharp
    return _averaged(sharp, normals.mask, min(radius, max(height, width)), progress)


def _averaged(sharp: F32, mask: Bools, radius: int, progress: Progress) -> F32:
    """Curvatures averaged over squares of several sizes, up to the radius."""
    radii = [radius, *(2**power for power in range(radius.bit_length()) if 2**power < radius)]
    summed = np.zeros(mask.shape, np.float32)
    for number, reach in enumerate(radii):
        progress(0.5 + 0.5 * number / len(radii), "curvature")
        total = box_sums(sharp, reach)
        total /= np.maximum(box_sums(mask.astype(np.float32), reach), 1)
        summed += (reach / sum(radii) * total).astype(np.float32)
    return np.where(mask, summed, np.float32(0))


def check_curvature(radius: int, limit: float | None = None) -> None:
    """Raise SettingsError if the radius, or the limit of an image, is out of range."""
    if radius < 0:
        raise SettingsError(f"a radius of {radius} pixels cannot be used; give 0 or more")
    if limit is not None and not 0 < limit < np.inf:
        raise SettingsError(f"a curvature's range must be a number above 0, not {limit:g}")


def curvature_range(values: Floats, mask: Bools) -> float:
    """A suitable range for an image of these curvatures.

    Parameters
    ----------
    values : (H, W) array
        Curvatures.
    mask : (H, W) bool array
        The pixels to consider.

    Returns
    -------
    float
        99 % of the mask's pixels are within plus and minus this; 1 if all are 0.
    """
    inside = np.abs(np.asarray(values)[np.asarray(mask, bool)])
    limit = float(np.quantile(inside[:: -(-len(inside) // _SAMPLED)], PICTURE_QUANTILE))
    return limit if limit > 0 else 1.0


def curvature_picture(values: Floats, limit: float) -> F32:
    """Curvatures as grey values: 0.5 is flat, white is convex by `limit` or more, black is concave by `limit` or more.

    Parameters
    ----------
    values : (H, W) array
        Curvatures in 1 / unit.
    limit : float
        Curvature that is white, above 0.

    Returns
    -------
    (H, W) float32 array
        0 to 1.

    Examples
    --------
    >>> curvature_picture(np.array([[-2.0, 0.0, 1.0]]), 2.0)
    array([[0.  , 0.5 , 0.75]], dtype=float32)
    """
    return np.clip(0.5 + 0.5 / limit * np.asarray(values), 0, 1).astype(np.float32)


def _divergence(normals: NormalMap, camera: Camera, depth: Floats | None, rows: slice) -> F32:
    """The divergence of the normals in some rows.

    With a = X / t and b = Y / t, where t is the depth, a field n(a, b) that is constant along the rays has
    div n = (dnx/da + dny/db + a dnz/da + b dnz/db) / t. Orthographic rays are parallel: div n = dnx/dX + dny/dY.
    """
    top, bottom = max(rows.start - 1, 0), min(rows.stop + 1, camera.height)
    mask, vectors = normals.mask[top:bottom], normals.vectors[top:bottom]
    own = slice(rows.start - top, rows.stop - top)
    to_right = _gradient(vectors[..., ::2], mask, axis=1)[own] * camera.focal[0]
    upwards = _gradient(vectors[..., 1:], mask, axis=0)[own] * -camera.focal[1]
    found = to_right[..., 0] + upwards[..., 0]
    if depth is not None:
        a, b, _ = np.moveaxis(camera.points(np.ones((rows.stop - rows.start, camera.width)), rows.start), -1, 0)
        found = (found + a * to_right[..., 1] + b * upwards[..., 1]) / np.where(normals.mask[rows], depth[rows], 1)
    return np.where(normals.mask[rows], found, 0).astype(np.float32)


def _gradient(values: Floats, mask: Bools, axis: int) -> Floats:
    """Finite differences of values (H, W, C): the mean of both sides, or the one that lies in the mask."""
    values, mask = values.swapaxes(0, axis), mask.swapaxes(0, axis)
    known = mask[1:] & mask[:-1]
    steps = np.where(known[..., None], values[1:] - values[:-1], 0)
    total, count = np.zeros_like(values), np.zeros(mask.shape, np.float32)
    for side in (slice(1, None), slice(None, -1)):
        total[side] += steps
        count[side] += known
    mean: Floats = total / np.maximum(count, 1)[..., None]
    return mean.swapaxes(0, axis)
