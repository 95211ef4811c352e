"""Integration of normals to heights."""

from typing import Literal, get_args

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box, labelled
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.height_map import HeightMap, pixels_per_unit
from mpsnet_core.relief.integration.bilateral import bilateral
from mpsnet_core.relief.integration.fast import fast
from mpsnet_core.relief.integration.gradients import gradients
from mpsnet_core.relief.sizes import check_size
from mpsnet_core.scene.camera import Camera, pixel_camera
from mpsnet_core.scene.normal_map import NormalMap

Method = Literal["fast", "bilateral"]
METHODS: tuple[Method, ...] = get_args(Method)

# The image is cropped to the object at multiples of this many pixels, so that the blocks of the solver's coarse grids
# do not depend on the object's position.
GRAIN = 32
# Limit of the logarithm of depth, which keeps depth finite for any normals.
MAX_LOG = 40.0


@takes_files
def integrate(
    normals: NormalMap,
    camera: Camera | None = None,
    *,
    method: Method = "fast",
    distance: float | None = None,
    progress: Progress = silent,
) -> HeightMap:
    """The heights whose normals are closest to those given.

    Parameters
    ----------
    normals : NormalMap
        Normals in camera space.
    camera : Camera, optional
        The photo's camera; :func:`mpsnet_core.scene.camera.pixel_camera` by default.
    method : {"fast", "bilateral"}
        "fast" is least squares over all pixels: a continuous surface, smeared at depth discontinuities. "bilateral"
        preserves these: it cuts the links between pixels where one is likely.
    distance : float, optional
        Mean depth of each connected piece along a perspective camera's axis; 1 by default.
    progress : Progress
        Receives the fraction done and a message.

    Returns
    -------
    HeightMap
        Heights in the camera's unit. For an orthographic camera, each 4-connected piece of the mask has mean height 0.

    Raises
    ------
    GeometryError
        If the sizes of normals and camera differ.
    SettingsError
        If the method is unknown, or the distance is not above 0 or given for an orthographic camera.

    Examples
    --------
    >>> normals = NormalMap(np.broadcast_to([-0.6, 0, 0.8], (4, 4, 3)), np.ones((4, 4), bool))
    >>> np.round(integrate(normals).values[0], 3)
    array([-1.125, -0.375,  0.375,  1.125], dtype=float32)
    """
    height, width = normals.mask.shape
    camera = camera or pixel_camera(width, height)
    _check(normals, camera, method, distance)
    progress(0.0, "integrating")
    solve = fast if method == "fast" else bilateral
    box, mask = grained_box(normals.mask), normals.mask[grained_box(normals.mask)]
    # Not named here, so that the solver can release them: they take much memory for a large photo.
    depth = solve(gradients(normals, camera, box), part(progress, 0.0, 0.98))
    values = np.zeros(normals.mask.shape, np.float32)
    values[box] = _in_unit(depth, mask, camera, distance or 1.0)
    progress(1.0, "integrated")
    return HeightMap(values, normals.mask, camera)


def grained_box(mask: Bools) -> tuple[slice, slice]:
    """Rows and columns of the object, widened to multiples of GRAIN; heights there do not depend on the rest."""
    rows, columns = (
        slice(side.start & -GRAIN, min(side.stop + GRAIN - 1 & -GRAIN, length))
        for side, length in zip(bounding_box(mask), mask.shape, strict=True)
    )
    return rows, columns


def _check(normals: NormalMap, camera: Camera, method: str, distance: float | None) -> None:
    check_size("camera", (camera.height, camera.width), normals)
    check_choice("method", method, METHODS)
    if distance is None:
        return
    if not (np.isfinite(distance) and distance > 0):
        raise SettingsError(f"the distance must be a number above 0, not {distance}")
    if camera.projection == "orthographic":
        raise SettingsError("an orthographic camera sees no distance; leave it out, or give a perspective camera")


def _in_unit(depth: F32, mask: Bools, camera: Camera, distance: float) -> F32:
    """Heights from the solver's result, with the requested mean for each piece."""
    labels, sizes = labelled(mask)
    pieces, sizes = labels[mask], np.maximum(sizes, 1)
    inside = depth[mask].astype(np.float64) / pixels_per_unit(camera)
    inside -= (np.bincount(pieces, inside, len(sizes)) / sizes)[pieces]
    if camera.projection == "perspective":
        inside = np.exp(np.clip(inside, -MAX_LOG, MAX_LOG))
        inside *= distance / (np.bincount(pieces, inside, len(sizes)) / sizes)[pieces]
    values = np.zeros(mask.shape, np.float32)
    values[mask] = -inside
    return values
