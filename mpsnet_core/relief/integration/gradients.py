"""Depth gradients from normals: for every pixel, the change to its neighbours."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.relief.height_map import pixels_per_unit
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# Limit of steepness (cosine of the angle to the line of sight; 87°). It applies to steeper normals and to those that
# face away from the camera, which cannot be seen. It is close to 90° for the rims of round objects, and does little
# harm: equations are weighted by the square of this cosine.
MIN_FACING = 0.05


@dataclass(frozen=True)
class Gradients:
    """Equations for every pixel: `facing * change = right`, and `= down`, with the unknown's change to the next pixel.

    The unknown is depth along the camera's axis, in pixels, for an orthographic camera, and the logarithm of depth,
    times the focal length in pixels, for a perspective one. The factor `facing` on both sides reduces the weight of
    steep pixels in least squares, because their gradients are uncertain.
    """

    facing: F32
    """(H, W) float32. The factor on the change, at least MIN_FACING inside the mask, 0 outside."""
    right: F32
    """(H, W) float32. `facing` times the change to the next pixel on the right, 0 outside the mask."""
    down: F32
    """(H, W) float32. `facing` times the change to the next pixel below, 0 outside the mask."""
    mask: Bools
    """(H, W) bool. Where the surface is."""


def gradients(normals: NormalMap, camera: Camera, box: tuple[slice, slice] | None = None) -> Gradients:
    """The changes of depth that normals (in camera space) require.

    box: the rows and columns of the result; None for all.

    A normal n is perpendicular to both tangents of the surface, the changes of its point p along columns and rows.
    Orthographic, with z up to a constant: n_z dz = -n_x dx. Perspective, with p = d (X, Y, -1) and u = log d:
    (n_z - n_x X - n_y Y) du = n_x dX, which is independent of the scale of d (Queau, Durou and Aujol, "Normal
    Integration: A Survey", 2018, section 2; Cao et al., "Bilateral Normal Integration", 2022, equation 6).
    """
    scale = pixels_per_unit(camera)
    height, width = normals.mask.shape
    x = ((np.arange(width) + 0.5 - camera.centre[0]) / camera.focal[0]).astype(np.float32)
    y = ((camera.centre[1] - np.arange(height) - 0.5) / camera.focal[1]).astype(np.float32)
    box = box or (slice(0, height), slice(0, width))
    vectors, mask, x, y = normals.vectors[box], normals.mask[box], x[box[1]], y[box[0], None]
    found = np.zeros((3, *mask.shape), np.float32)
    for rows in bands(len(mask)):
        n_x, n_y, n_z = np.moveaxis(vectors[rows], -1, 0)
        facing = n_z if camera.projection == "orthographic" else n_z - n_x * x - n_y * y[rows]
        inside = mask[rows]
        found[0, rows][inside] = np.maximum(facing, MIN_FACING)[inside]
        found[1, rows][inside] = (n_x * np.float32(scale / camera.focal[0]))[inside]
        found[2, rows][inside] = (n_y * np.float32(-scale / camera.focal[1]))[inside]
    return Gradients(found[0], found[1], found[2], mask)
