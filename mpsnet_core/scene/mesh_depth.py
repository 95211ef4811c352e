"""Depth maps of meshes, and masks of what a camera sees of them."""

import numpy as np

from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import RayScene

# A mask from the mesh is ray cast at up to this many pixels on the longer side.
MASK_PIXELS = 2048


@takes_files
def depth_of_mesh(camera: Camera, scene: RayScene) -> F32:
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
            "the camera does not see the mesh; check that both share one world, and that the camera faces the mesh"
        )
    return depth


def mesh_mask(camera: Camera, scene: RayScene) -> Bools:
    """(H, W) bool: the pixels in which the camera sees the mesh. Large images are sampled in blocks of a few pixels."""
    small = reduced_shape(camera.height, camera.width, MASK_PIXELS)
    rows, columns = chosen_pixels(*small, camera.height, camera.width)
    pixels = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), axis=-1).reshape(-1, 2)
    origins, directions, _ = scene.rays_of(camera, pixels)
    seen = np.isfinite(scene.distances(origins, directions)).reshape(small)
    mask: Bools = seen[np.ix_(*chosen_pixels(camera.height, camera.width, *small))]
    return mask
