"""Which points of a mesh a camera sees."""

import logging

import numpy as np

from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.upsample import reduced_shape
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

# Pixels on the longer side of the depth map that decides the easy cases.
DEPTH_PIXELS = 1024
# Second differences of depth above this many pixel widths are silhouettes or creases.
SHARPEST_BEND = 0.5
# Above this many, they are depth discontinuities: one surface occludes another.
BREAK = 3.0
# Offset of ray origins from the surface, as a fraction of the mesh's size, against self-intersection.
OFFSET = 1e-4


class Visibility:
    """Whether points on the scene's mesh are visible from `camera`, by shadow rays (Embree).

    A depth map with a small plane per pixel decides points far from any silhouette. Only the others need a ray.

    shape: (h, w) of the depth map. unbroken: (h, w) bool, where the surface continues on all sides, without a depth
    discontinuity. footprint: approximate size of one of its pixels on the object.
    """

    def __init__(self, camera: Camera, scene: RayScene) -> None:
        self.camera, self.scene = camera, scene
        self.offset = OFFSET * scene.size
        self.shape = height, width = reduced_shape(camera.height, camera.width, DEPTH_PIXELS)
        self.scale = np.float32(width / camera.width), np.float32(height / camera.height)
        # Crop the depth map to the mesh.
        self.rows, self.columns = rows, columns = scene.extent(camera.resized(width, height))
        x, y = (np.arange(part.start, part.stop) + 0.5 for part in (columns, rows))
        depth = scene.depths(camera, x * (camera.width / width), y * (camera.height / height))
        distance = np.float32(scene.depth_of_middle(camera))
        spacing = np.float32(max(camera.height, camera.width) / (max(height, width) * float(camera.focal.min())))
        pixel = np.full_like(depth, spacing) if camera.projection == "orthographic" else spacing * (depth + distance)
        seen = np.isfinite(depth)
        # Rays of an orthographic camera start behind its plane, at `distance`.
        if seen.any() and depth[seen].max() + distance < -self.offset:
            log.warning(
                "an orthographic camera looks away from the mesh: the mesh lies behind it, but is baked as if "
                "it were in front; check the axes of the camera's pose (it looks along -z, y is up)"
            )
        self.footprint = float(np.median(pixel[seen])) if seen.any() else 1.0
        padded = np.pad(depth, 1, constant_values=np.inf)
        left, right, above, below = padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]
        with np.errstate(invalid="ignore"):
            bend = np.maximum(np.abs(left + right - 2 * depth), np.abs(above + below - 2 * depth))
            smooth = bend <= SHARPEST_BEND * pixel
            self.unbroken = np.zeros((height, width), bool)
            self.unbroken[rows, columns] = np.isfinite(bend) & (bend <= BREAK * pixel)
            # The plane's depth at the pixel's centre, with a tolerance, and its gradient per pixel to the right and
            # down; NaN where the depth is not smooth. A fourth value aligns rows to 16 bytes for fast lookup.
            self.planes = np.zeros((*depth.shape, 4), np.float32)
            self.planes[..., 0] = np.where(
                smooth, depth + SHARPEST_BEND * pixel + np.float32(2 * self.offset), np.float32(np.nan)
            )
            self.planes[..., 1] = (right - left) / 2
            self.planes[..., 2] = (below - above) / 2

    def seen(self, points: F32, x: F32, y: F32, depth: F32) -> Bools:
        """(N,) visibility of points (3, N), relative to the scene's centre, at pixels x and y (N,) of the image.

        depth: (N,) along the camera's axis, relative to the scene's centre. The points must face the camera.
        """
        height, width = self.planes.shape[:2]
        x, y = x * self.scale[0] - np.float32(self.columns.start), y * self.scale[1] - np.float32(self.rows.start)
        column, row = x.astype(np.int32), y.astype(np.int32)
        np.clip(column, 0, width - 1, out=column)
        np.clip(row, 0, height - 1, out=row)
        plane = self.planes.reshape(-1, 4).take(row * width + column, axis=0)
        x -= column
        y -= row
        x -= np.float32(0.5)
        y -= np.float32(0.5)
        with np.errstate(invalid="ignore"):
            seen: Bools = depth <= plane[:, 0] + plane[:, 1] * x + plane[:, 2] * y
        unsure = np.flatnonzero(np.isnan(plane[:, 0]))
        if len(unsure):
            seen[unsure] = ~self._hidden(points[:, unsure])
        return seen

    def _hidden(self, points: F32) -> Bools:
        """(N,) whether points (3, N) are occluded from the camera."""
        if self.camera.projection == "perspective":
            eye = self.camera.world_from_camera[:3, 3] - self.scene.middle
            towards = eye.astype(np.float32)[:, None] - points
            reach = np.sqrt(np.einsum("in,in->n", towards, towards))
            towards /= reach
        else:
            towards = np.broadcast_to(self.camera.rotation[:, 2:].astype(np.float32), points.shape)
            reach = np.full(points.shape[1], np.inf, np.float32)
        start = points + np.float32(self.offset) * towards
        return self.scene.occluded_within(start.T, towards.T, reach - np.float32(2 * self.offset))
