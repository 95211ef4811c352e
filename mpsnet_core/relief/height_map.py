"""Checks of the sizes of arrays that go with a normal map, and of textures on UVs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.shown import Shown
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# Largest side of a texture on UVs that is integrated to heights; takes about 11 GB.
MAX_SIZE = 8192


def check_size(what: str, shape: Sequence[int], normals: NormalMap) -> None:
    """Raise GeometryError if an array of `shape` (H, W, ...) and the normals differ in size. what: its name."""
    check_same_size(f"the {what}", shape[:2], "the normal map", normals.mask.shape)


def check_square(height: int, width: int) -> None:
    """Raise GeometryError if a texture on UVs is not square."""
    if height != width:
        raise GeometryError(f"heights on UVs need a square texture, not {width} x {height} texels; bake it square")


# ----------------------------------------------------------------------------------------------------------------------
# Height maps: the surface's height towards the camera at every pixel, also as a field over the image.


@takes_files
@dataclass(frozen=True, eq=False, repr=False)
class HeightMap(Shown):
    """Heights in camera space along the z axis, which points towards the camera.

    Raises
    ------
    GeometryError
        If the sizes differ, the mask is empty or a height inside it is not finite.

    Examples
    --------
    >>> from mpsnet_core.scene.camera import pixel_camera
    >>> heights = HeightMap(np.ones((2, 3)), np.ones((2, 3), bool), pixel_camera(3, 2))
    >>> heights.points()[0, 0]
    array([-1. ,  0.5,  1. ])
    """

    array_name: ClassVar[str] = "values"

    values: F32
    """(H, W) float32. Heights in the camera's unit, 0 outside the mask. With an orthographic camera, each connected
    piece of the mask is known up to a constant; with a perspective one, up to a factor, and heights are below 0."""
    mask: Bools
    """(H, W) bool. Where the surface is."""
    camera: Camera
    """The photo's camera; :func:`mpsnet_core.scene.camera.pixel_camera` if it is unknown."""

    def __post_init__(self) -> None:
        values, mask = np.asarray(self.values, np.float32), np.asarray(self.mask, bool)
        if values.ndim != 2 or values.shape != mask.shape:
            raise GeometryError(f"heights of shape {values.shape} do not fit a mask of shape {mask.shape}")
        check_same_size("the camera", (self.camera.height, self.camera.width), "its heights", mask.shape)
        if not mask.any():
            raise GeometryError("the height map's mask is empty; there is nothing to work on")
        if not np.isfinite(values[mask]).all():
            raise GeometryError("the height map holds values that are not finite inside its mask; integrate again")
        object.__setattr__(self, "values", np.where(mask, values, np.float32(0)))
        object.__setattr__(self, "mask", mask)

    def facts(self) -> str:
        inside = self.values[self.mask]
        return f"{len(inside):,} heights from {inside.min():.4g} to {inside.max():.4g}"

    def picture(self, step: int = 1) -> F32:
        from mpsnet_core.scene.pictures import error_picture

        inside = self.values[self.mask]
        low, high = float(inside.min()), float(inside.max())
        values = self.values[::step, ::step] - low
        return error_picture(values, self.mask[::step, ::step], max(high - low, 1e-30))

    def points(self) -> Floats:
        """(H, W, 3) points in camera space, meaningless outside the mask."""
        return self.camera.points(-self.values)


def parallel_heights(heights: HeightMap) -> F32:
    """(H, W) heights in the camera's unit, 0 outside the mask. Planes stay planes, and occlusion is preserved.

    Heights of an orthographic camera are unchanged. For a perspective one, -1 / depth, which maps straight lines to
    straight lines, is scaled and shifted to be 0 and have the slope of the heights at :func:`mean_depth`. Over the
    image plane at that depth, a gradient m is the direction ``e + m (t / d) q`` at depth t, where d is the mean depth,
    e a unit vector in the image plane, and q = (-x, -y, 1) points to the camera: the ray meets depth 1 at (x, y).
    """
    if heights.camera.projection == "orthographic":
        return heights.values
    middle = mean_depth(heights)
    depth = np.where(heights.mask, -heights.values, np.float32(middle)).astype(np.float64)
    return (middle * middle / depth - middle).astype(np.float32)


def mean_depth(heights: HeightMap) -> float:
    """The mean depth along a perspective camera's axis; 1 for an orthographic one, where it is unknown."""
    if heights.camera.projection == "orthographic":
        return 1.0
    return -float(heights.values[heights.mask].mean(dtype=np.float64))


def pixel_size(heights: HeightMap) -> float:
    """Size of a pixel, in the camera's unit, at :func:`mean_depth`."""
    return mean_depth(heights) / pixels_per_unit(heights.camera)


def pixels_per_unit(camera: Camera) -> float:
    """Pixels per unit of length at depth 1: one number, even if pixels are not square."""
    return float(np.sqrt(camera.focal.prod()))
