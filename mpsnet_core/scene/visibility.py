"""Which points of a mesh a camera sees."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.upsample import reduced_shape
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

# The longer side of the depth map that settles the easy cases.
DEPTH_PIXELS = 1024
# Second differences of depth above this many pixel widths are silhouettes or creases.
SHARPEST_BEND = 0.5
# Above this, one surface occludes another.
BREAK = 3.0
# A ray starts this share of the mesh's size off the surface, so that it does not hit where it starts.
OFFSET = 1e-4


class Visibility:
    """Whether points on the scene's mesh are visible from `camera`, by shadow rays (embree).

    A depth map, a small plane per pixel, settles points far from any silhouette; only the others cost a ray.

    shape: (h, w) of the depth map. unbroken: (h, w) bool, where its surface continues to all sides.
    footprint: about the size of one of its pixels on the object.
    """

    def __init__(self, camera: Camera, scene: RayScene) -> None:
        self.camera, self.scene = camera, scene
        self.offset = OFFSET * scene.size
        self.shape = height, width = reduced_shape(camera.height, camera.width, DEPTH_PIXELS)
        y, x = np.mgrid[:height, :width].reshape(2, -1) + 0.5
        points = np.stack([x * camera.width / width, y * camera.height / height], axis=1)
        origins, directions, back = scene.rays_of(camera, points)
        distance = scene.distances(origins, directions) - back
        # Distance along the ray to depth along the camera's axis.
        depth = (distance * (directions @ -camera.rotation[:, 2])).reshape(height, width)
        apart = max(camera.height, camera.width) / (max(height, width) * float(camera.focal.min()))
        pixel = np.full_like(depth, apart) if camera.projection == "orthographic" else apart * depth
        seen = np.isfinite(depth)
        if seen.any() and depth[seen].max() < -self.offset:  # an orthographic camera's rays begin behind its plane
            log.warning(
                "an orthographic camera looks away from the mesh: all that it sees of it lies behind it, and is baked "
                "as if it stood before it; is the camera's pose given in the right axes (it looks along -z, y is up)?"
            )
        self.footprint = float(np.median(pixel[seen])) if seen.any() else 1.0
        padded = np.pad(depth, 1, constant_values=np.inf)
        left, right, above, below = padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]
        with np.errstate(invalid="ignore"):
            bend = np.maximum(np.abs(left + right - 2 * depth), np.abs(above + below - 2 * depth))
            self.smooth = np.isfinite(bend) & (bend <= SHARPEST_BEND * pixel)
            self.unbroken = np.isfinite(bend) & (bend <= BREAK * pixel)
            planes = [depth + SHARPEST_BEND * pixel + 2 * self.offset, (right - left) / 2, (below - above) / 2]
        # The plane's depth at the pixel's middle, with a tolerance, and its gradient per pixel to the right and down.
        self.planes = np.where(self.smooth[..., None], np.stack(planes, axis=-1), 0)

    def seen(
        self, points: NDArray[np.floating[Any]], pixels: NDArray[np.floating[Any]], depth: NDArray[np.floating[Any]]
    ) -> NDArray[np.bool_]:
        """(N,) bool for points (N, 3) in world space at `pixels` (N, 2) of the camera's image and `depth` (N,).

        The points must face the camera.
        """
        height, width = self.shape
        x, y = (pixels * (width / self.camera.width, height / self.camera.height)).T
        column = np.clip(x.astype(np.int32), 0, width - 1)
        row = np.clip(y.astype(np.int32), 0, height - 1)
        index = row * width + column
        unsure = np.flatnonzero(~self.smooth.ravel()[index])
        middle, right, down = self.planes.reshape(-1, 3)[index].T
        seen: NDArray[np.bool_] = depth <= middle + right * (x - column - 0.5) + down * (y - row - 0.5)
        if len(unsure):
            seen[unsure] = ~self._hidden(points[unsure])
        return seen

    def _hidden(self, points: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        towards = np.broadcast_to(self.camera.rotation[:, 2], points.shape)
        reach = np.full(len(points), np.inf)
        if self.camera.projection == "perspective":
            towards = self.camera.world_from_camera[:3, 3] - points
            reach = np.linalg.norm(towards, axis=1)
            towards = towards / reach[:, None]
        return self.scene.distances(points + self.offset * towards, towards) < reach - 2 * self.offset
