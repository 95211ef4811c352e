"""Near lights and perspective removed from a photo: what it would be from afar, under distant lights.

The networks have learned one direction for each light and see the whole picture at once. In a photo from nearby every
pixel has lights and a line of sight of its own. Where a matt surface is lit by all three lights, its normal times its
albedo follows from the pixel (equation 2, with the lights as they are there); turned so that the line of sight becomes
the z axis and lit anew by the rig's directions, it is the pixel that a distant camera would see under distant lights.
The same 3 x 3 matrix is used for every pixel. Where a light does not reach, a little light comes in that was not there;
shine is treated as if it were matt. Measured against alternatives that need the answer first, this was the best.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.capture.capture import Capture
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import LightRig

# A band of pixels takes some hundred bytes a pixel on the way.
ROWS = 32


def under_distant_lights(capture: Capture) -> Capture:
    """The capture of near lights as its rig's directions would light it from afar.

    Exact for a matt surface that all three lights reach; values can be below zero elsewhere. The mixing is undone.
    """
    return _relit(capture, turned=False)


def as_distant_lights(capture: Capture) -> Capture:
    """The capture under distant lights and with every line of sight turned into the z axis, never below zero.

    Itself where lights and camera are distant. Normals that are estimated from it are rotated back by
    :func:`turn_back`.
    """
    if capture.rig.near is None and not _is_perspective(capture.camera):
        return capture
    return _relit(capture, turned=True)


def turn_back(normals: NDArray[np.float32], camera: Camera | None) -> None:
    """Rotate normals (H, W, 3) that were estimated from afar into camera space, in place."""
    if not _is_perspective(camera):
        return
    for rows in bands(len(normals), ROWS):
        normals[rows] = _turned(normals[rows], -_turn_to_z(camera, rows))


def _relit(capture: Capture, *, turned: bool) -> Capture:
    image = np.zeros_like(capture.image)
    for rows, lights in lights_by_rows(capture):
        normals = pseudo_normals(capture.rig.unmixed(capture.image[rows]), lights)
        if turned and _is_perspective(capture.camera):
            normals = _turned(normals, _turn_to_z(capture.camera, rows))
        lit = normals @ capture.rig.directions.T
        image[rows] = np.where(capture.mask[rows, :, None], np.maximum(lit, 0) if turned else lit, 0)
    return replace(capture, image=image, rig=LightRig(capture.rig.directions, exact=capture.rig.exact), clip=np.inf)


def lights_by_rows(capture: Capture) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Bands of rows, and the lights there as :func:`lights_in` has them."""
    for rows in bands(len(capture.mask), ROWS):
        yield rows, lights_in(capture, rows)


def lights_in(capture: Capture, rows: slice) -> NDArray[np.float64]:
    """The lights in some rows: (h, W, 3, 3), or (3, 3) where they are the same for all. A light a row, its direction
    times its brightness."""
    near, camera, depth = capture.rig.near, capture.camera, capture.depth
    if near is None:
        return capture.rig.directions
    assert camera is not None and depth is not None  # a capture with near lights has both
    return near.lights_at(camera.points(np.where(capture.mask[rows], depth[rows], 1), rows.start))


def pseudo_normals(light: NDArray[np.floating[Any]], lights: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Equation 2 where every pixel has lights of its own: normals times albedo, (..., 3).

    light: (..., 3) each light alone (unmixed). lights: (..., 3, 3), a light a row, as long as it is bright.
    """
    first, second, third = (lights[..., number, :] for number in range(3))
    across = np.cross(second, third)
    volume = dot(first, across)[..., None]
    # Where the three lights lie in one plane no normal follows.
    volume = np.where(np.abs(volume) < 1e-9, 1e-9, volume)
    result: NDArray[np.float64] = (
        light[..., :1] * across + light[..., 1:2] * np.cross(third, first) + light[..., 2:] * np.cross(first, second)
    ) / volume
    return result


def pseudo_normals_by_light(light: NDArray[np.floating[Any]], lights: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(N, 3, 3) what each light adds to :func:`pseudo_normals` of pixels (N, 3): their sum is that."""
    parts: NDArray[np.float64] = light[:, :, None] * np.stack(
        [pseudo_normals(axis, lights) for axis in np.eye(3)], axis=-2
    )
    return parts


def _is_perspective(camera: Camera | None) -> TypeGuard[Camera]:
    return camera is not None and camera.projection == "perspective"


def _turn_to_z(camera: Camera, rows: slice) -> NDArray[np.float64]:
    """(h, W, 3) axes of the smallest turns that bring lines of sight onto z, as long as the angles' sines."""
    towards = -camera.points(np.ones((rows.stop - rows.start, camera.width)), rows.start)
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    return np.cross(towards, [0.0, 0.0, 1.0])


def _turned(vectors: NDArray[np.floating[Any]], axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors turned about axes that are as long as the sine of the angle, which is below 90° (Rodrigues)."""
    cosine = np.sqrt(1 - dot(axes, axes))[..., None]
    once = np.cross(axes, vectors)
    turned: NDArray[np.float64] = vectors + once + np.cross(axes, once) / (1 + cosine)
    return turned
