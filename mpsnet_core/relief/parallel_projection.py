"""Heights in a space where the camera's rays are parallel: a height field over the image, for any camera."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.integration.gradients import pixels_per_unit


def parallel_heights(heights: HeightMap) -> NDArray[np.float32]:
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
