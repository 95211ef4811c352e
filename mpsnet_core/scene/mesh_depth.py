"""Depth maps of meshes."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import RayScene


def depth_of_mesh(camera: Camera, scene: RayScene) -> NDArray[np.float32]:
    """Depth map of a mesh, by a ray through each pixel's centre.

    Parameters
    ----------
    camera : Camera
    scene : RayScene
        The mesh, in the camera's world space.

    Returns
    -------
    (H, W) float32 array
        Depth along the optical axis in world units; infinity where there is no surface.

    Raises
    ------
    GeometryError
        If the camera does not see the mesh.

    Examples
    --------
    >>> square = np.array([[-1, -1, -5], [1, -1, -5], [1, 1, -5], [-1, 1, -5.0]])
    >>> scene = RayScene(square, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> depth_of_mesh(Camera("perspective", 4, 1, np.array([5.0, 5.0])), scene).tolist()
    [[inf, 5.0, 5.0, inf]]
    """
    x, y = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    depth = scene.depths(camera, x, y)
    depth += np.float32(scene.depth_of_middle(camera))
    if not np.isfinite(depth).any():
        raise GeometryError(
            "the camera does not see the mesh; check that both are of one world, and that it looks at it"
        )
    return depth
