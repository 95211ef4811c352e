"""Overlay of a fitted mesh on the photo."""

from collections.abc import Sequence

import numpy as np

from mpsnet_core.arrays.mask_regions import dilated, eroded
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.estimate.alignment.pose import Poses
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.pictures import OUTLINE_COLOUR, photo_picture
from mpsnet_core.scene.rays import RayScene

MESH_COLOUR = (0.15, 1.0, 0.4)
USED_COLOUR, LEFT_OUT_COLOUR = (0.2, 0.6, 1.0), (1.0, 0.1, 0.1)


def overlay(
    image: F32,
    mask: Bools,
    scene: RayScene,
    camera: Camera,
    pairs: tuple[Floats, Floats] | None,
    left_out: Sequence[int],
) -> F32:
    """(H, W, 3) display values: the dimmed photo, the mask's outline in orange, the mesh's outline in green.

    Parameters
    ----------
    image
        (H, W, 3) the photo, linear.
    mask
        (H, W) where the object is.
    scene
        The mesh.
    camera
        With the photo's size.
    pairs
        Pixels (N, 2) and points (N, 3). Each is a cross at its pixel, blue or, if left out, red, with a line to the
        projection of its point.
    left_out
        Numbers of the pairs that were not used, from 0.
    """
    picture = 0.7 * photo_picture(image, mask)
    seen = np.isfinite(scene.depths(camera, np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5))
    wide = max(1, round(max(mask.shape) / 700))
    for region, colour in ((mask, OUTLINE_COLOUR), (seen, MESH_COLOUR)):
        picture[dilated(region, wide) & ~eroded(region, 1)] = colour
    if pairs is not None:
        pixels, points = pairs
        poses = Poses.of(camera)
        projected_points = poses.projected(poses.in_camera(points))[0]
        for number, (start, end) in enumerate(zip(pixels, projected_points, strict=True)):
            colour = LEFT_OUT_COLOUR if number in left_out else USED_COLOUR
            right, down = np.array([4.0 * wide, 0]), np.array([0, 4.0 * wide])
            for a, b in ((start, end), (start - right, start + right), (start - down, start + down)):
                _line(picture, a, b, colour, wide)
    return picture.astype(np.float32)


def _line(picture: F32, start: Floats, end: Floats, colour: tuple[float, ...], wide: int) -> None:
    height, width, _ = picture.shape
    count = int(np.clip(np.abs(end - start).max() * 2, 1, 4 * max(height, width))) + 1
    places = start + (end - start) * np.linspace(0, 1, count)[:, None]
    for offset in range(-(wide // 2), wide - wide // 2):
        for x, y in ((places[:, 0] + offset, places[:, 1]), (places[:, 0], places[:, 1] + offset)):
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            picture[y[inside].astype(int), x[inside].astype(int)] = colour
