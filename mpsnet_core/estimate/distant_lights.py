"""Remove near lights and perspective from a photo: convert it to distant lights and a distant camera.

The networks are trained on distant lights and orthographic cameras. In a photo from nearby every pixel has its own
light directions and line of sight. Equation 2 with the lights at that pixel gives the normal times the albedo, exactly
where the surface is matt and all three lights reach it. Rotated so that the line of sight becomes the z axis, and lit
by the rig's directions, it is the pixel that a distant camera would see under distant lights.

Pixels in shadow or with highlights are converted in the same way: shadows gain a little light, and highlights are
treated as matt. This was more accurate than the alternatives, which need an estimate of the normals first.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, Floats
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.capture.capture import Capture
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import LightRig

# Rows converted at a time; intermediate arrays take some hundred bytes a pixel.
ROWS = 32


def convert_to_distant_lights(capture: Capture) -> Capture:
    """The capture, unmixed, as distant lights from the rig's directions would light it.

    Exact for a matt surface that all three lights reach; elsewhere values can be below zero.
    """
    return _relight(capture, rotate=False)


def convert_to_distant_view(capture: Capture) -> Capture:
    """The capture under distant lights, with every line of sight rotated onto the z axis; clipped at zero.

    A capture with distant lights and camera is returned unchanged. :func:`rotate_to_camera_space` rotates the normals
    estimated from the result back into camera space.
    """
    if capture.rig.near is None and not _is_perspective(capture.camera):
        return capture
    return _relight(capture, rotate=True)


def rotate_to_camera_space(normals: F32, camera: Camera | None) -> None:
    """Rotate normals (H, W, 3) estimated from :func:`convert_to_distant_view` into camera space, in place."""
    if not _is_perspective(camera):
        return
    for rows in bands(len(normals), ROWS):
        normals[rows] = _rotate(normals[rows], -_rotation_to_z(camera, rows))


def _relight(capture: Capture, *, rotate: bool) -> Capture:
    image = np.zeros_like(capture.image)
    for rows, lights in bands_with_lights(capture):
        normals = pseudo_normals(capture.rig.unmixed(capture.image[rows]), lights)
        if rotate and _is_perspective(capture.camera):
            normals = _rotate(normals, _rotation_to_z(capture.camera, rows))
        lit = normals @ capture.rig.directions.T
        image[rows] = np.where(capture.mask[rows, :, None], np.maximum(lit, 0) if rotate else lit, 0)
    rig = LightRig(capture.rig.directions, is_ground_truth=capture.rig.is_ground_truth)
    return replace(capture, image=image, rig=rig, clip=np.inf)


def bands_with_lights(capture: Capture) -> Iterator[tuple[slice, F64]]:
    """Bands of rows, each with its lights as :func:`lights_in` returns them."""
    for rows in bands(len(capture.mask), ROWS):
        yield rows, lights_in(capture, rows)


def lights_in(capture: Capture, rows: slice) -> F64:
    """Light directions times brightness at the pixels of some rows, one light per matrix row: (h, W, 3, 3), or (3, 3)
    for distant lights."""
    near, camera, depth = capture.rig.near, capture.camera, capture.depth
    if near is None:
        return capture.rig.directions
    assert camera is not None and depth is not None  # a capture with near lights has both
    return near.lights_at(camera.points(np.where(capture.mask[rows], depth[rows], 1), rows.start))


def pseudo_normals(light: Floats, lights: Floats) -> F64:
    """Equation 2 with lights for each pixel: normals times albedo, (..., 3).

    light: (..., 3) unmixed image values. lights: (..., 3, 3) directions times brightness, one light per row.
    """
    first, second, third = (lights[..., number, :] for number in range(3))
    across = np.cross(second, third)
    volume = dot(first, across)[..., None]
    # Three lights in one plane determine no normal; keep the division finite.
    volume = np.where(np.abs(volume) < 1e-9, 1e-9, volume)
    others = light[..., 1:2] * np.cross(third, first) + light[..., 2:] * np.cross(first, second)
    return (light[..., :1] * across + others) / volume


def pseudo_normals_by_light(light: Floats, lights: Floats) -> F64:
    """(N, 3, 3) the contribution of each light to :func:`pseudo_normals` of pixels (N, 3); axis 1 sums to it."""
    return light[:, :, None] * np.stack([pseudo_normals(axis, lights) for axis in np.eye(3)], axis=-2)


def _is_perspective(camera: Camera | None) -> TypeGuard[Camera]:
    return camera is not None and camera.projection == "perspective"


def _rotation_to_z(camera: Camera, rows: slice) -> F64:
    """(h, W, 3) axes of the smallest rotations from lines of sight onto z; their length is the sine of the angle."""
    towards = -camera.points(np.ones((rows.stop - rows.start, camera.width)), rows.start)
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    return np.cross(towards, [0.0, 0.0, 1.0])


def _rotate(vectors: Floats, axes: F64) -> F64:
    """Rotate vectors about axes whose length is the sine of the angle, below 90° (Rodrigues' formula)."""
    cosine = np.sqrt(1 - dot(axes, axes))[..., None]
    once = np.cross(axes, vectors)
    return vectors + once + np.cross(axes, once) / (1 + cosine)
