"""A Blender camera as the core's."""

from typing import Any

import numpy as np

from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import Camera


def scene_camera(camera: Any, scene: Any, size: tuple[int, int] | None = None) -> Camera:
    """A Blender camera as the core's: its pose, and its focal length and centre in pixels.

    size: width and height of the image in square pixels; the scene's resolution by default.

    Raises InputError for a panoramic or custom camera, and for one that its parents shear.
    """
    data = camera.data
    scale = [abs(one) for one in camera.matrix_world.to_scale()]
    if camera.parent and max(scale) > min(scale) * 1.001:
        raise InputError(
            f'camera "{camera.name}" is stretched, as the object that it belongs to is; apply the scale of that object '
            "(Ctrl A), then align the photo again"
        )
    if data.type not in {"PERSP", "ORTHO"}:
        raise InputError(
            f'camera "{camera.name}" is panoramic or has a shader of its own; make it orthographic or perspective in '
            "its properties"
        )
    render = scene.render
    if size is None:
        width = int(render.resolution_x * render.resolution_percentage / 100)
        height = int(render.resolution_y * render.resolution_percentage / 100)
        aspect = np.array([render.pixel_aspect_x, render.pixel_aspect_y])
    else:
        (width, height), aspect = size, np.ones(2)
    extent = np.array([width, height]) * aspect
    across = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and extent[0] >= extent[1])
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    fitted = extent[0 if across else 1]
    per_unit = fitted / data.ortho_scale if data.type == "ORTHO" else fitted * data.lens / sensor
    shift = np.array([data.shift_x, -data.shift_y]) * fitted / aspect
    return Camera(
        "orthographic" if data.type == "ORTHO" else "perspective",
        width,
        height,
        per_unit / aspect,
        np.array([width, height]) / 2 - shift,
        np.array(camera.matrix_world.normalized(), dtype=np.float64),
    )
