"""How far each pixel's surface is from the camera, told from a mesh."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import RayScene


def depth_of_mesh(camera: Camera, scene: RayScene) -> NDArray[np.float32]:
    """(H, W) how far in front of the camera, along its axis, the scene's mesh is in each pixel; infinity beside it.

    In the unit of the mesh's world. Raises InputError where the camera sees nothing of the mesh.
    """
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    x = np.arange(camera.width) + 0.5
    for rows in bands(camera.height):
        y = np.arange(rows.start, rows.stop) + 0.5
        points = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1).reshape(-1, 2)
        origins, directions = camera.rays(points)
        along = directions @ -camera.rotation[:, 2]
        depth[rows] = (scene.distances(origins, directions) * along).reshape(-1, camera.width)
    if not np.isfinite(depth).any():
        raise InputError("the camera does not see the mesh; check that both are of one world, and that it looks at it")
    return depth
