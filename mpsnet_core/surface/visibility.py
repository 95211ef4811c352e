"""Which points of a mesh a camera sees."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.camera import Camera
from mpsnet_core.surface.mesh import Mesh

# The depth image that settles easy cases is traced at no more than this many pixels on its longer side.
DEPTH_PIXELS = 1024
# Neighbouring depths that differ by more than this many pixel widths are a silhouette, or too steep to interpolate.
STEEPEST = 4.0
# A ray starts this share of the mesh's size off the surface, so that it does not hit where it starts.
OFFSET = 1e-4


class Visibility:
    """Tells whether points on `mesh` can be seen from `camera`, by rays (embree) against the mesh.

    A depth image settles points far from any silhouette; only the others cost a ray.
    """

    def __init__(self, mesh: Mesh, camera: Camera, scene: "RayScene") -> None:
        self.camera, self.scene = camera, scene
        self.offset = OFFSET * float(np.linalg.norm(np.ptp(mesh.world_vertices, axis=0)))
        self.scale = min(1.0, DEPTH_PIXELS / max(camera.width, camera.height))
        width, height = max(1, round(camera.width * self.scale)), max(1, round(camera.height * self.scale))
        self.shape = (height, width)
        y, x = np.mgrid[:height, :width].reshape(2, -1) + 0.5
        points = np.stack([x * camera.width / width, y * camera.height / height], axis=1)
        origins, directions = camera.rays(points)
        distance = scene.distances(origins, directions)
        # Distance along the ray to depth along the camera's axis.
        depth = distance * (directions @ -camera.rotation[:, 2])
        depth = depth.reshape(height, width)
        near, far = _extremes(depth)
        pixel = depth / (camera.focal.min() * self.scale)
        if camera.projection == "orthographic":
            pixel = np.full_like(depth, 1 / (camera.focal.min() * self.scale))
        with np.errstate(invalid="ignore"):
            smooth = np.isfinite(far) & (far - near <= STEEPEST * pixel)
        self.smooth = smooth
        self.far = np.where(smooth, far, 0).astype(np.float32)

    def seen(
        self, points: NDArray[np.floating], pixels: NDArray[np.floating], depth: NDArray[np.floating]
    ) -> NDArray[np.bool_]:
        """(N,) bool for points (N, 3) in world space at `pixels` (N, 2) of the camera's image and `depth` (N,).

        The points must face the camera.
        """
        height, width = self.shape
        column = np.clip((pixels[:, 0] * (width / self.camera.width)).astype(np.int32), 0, width - 1)
        row = np.clip((pixels[:, 1] * (height / self.camera.height)).astype(np.int32), 0, height - 1)
        index = row * width + column
        seen = self.smooth.ravel()[index]
        unsure = np.flatnonzero(~seen)
        seen &= depth <= self.far.ravel()[index] + 2 * self.offset
        if len(unsure):
            seen[unsure] = ~self._hidden(points[unsure])
        return seen

    def _hidden(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        towards = np.broadcast_to(self.camera.rotation[:, 2], points.shape)
        reach = np.full(len(points), np.inf)
        if self.camera.projection == "perspective":
            towards = self.camera.world_from_camera[:3, 3] - points
            reach = np.linalg.norm(towards, axis=1)
            towards = towards / reach[:, None]
        return self.scene.distances(points + self.offset * towards, towards) < reach - 2 * self.offset


class RayScene:
    """A mesh made ready for ray casting in world space (embree)."""

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        # embree works in float32: centred and scaled to about 1, it does not matter where the object stands.
        low, high = mesh.world_vertices.min(axis=0), mesh.world_vertices.max(axis=0)
        self.middle, self.size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
        self.scene = EmbreeScene()
        corners = ((mesh.world_vertices - self.middle) / self.size)[mesh.triangles]
        self.mesh = TriangleMesh(self.scene, corners.astype(np.float32))

    def distances(self, origins: NDArray[np.floating], directions: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N,) distance along each ray to the first hit, infinity where it hits nothing. Unit directions (N, 3)."""
        start = np.ascontiguousarray((origins - self.middle) / self.size, np.float32)
        heading = np.ascontiguousarray(directions, np.float32)
        found = np.asarray(self.scene.run(start, heading, query="DISTANCE"), np.float64)
        return np.where(found > 1e30, np.inf, found * self.size)


def _extremes(depth: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least and the greatest depth in each pixel's 3 x 3 neighbourhood."""
    padded = np.pad(depth, 1, constant_values=np.inf)
    rows = padded[:-2], padded[1:-1], padded[2:]
    near, far = np.minimum.reduce(rows), np.maximum.reduce(rows)
    near = np.minimum.reduce((near[:, :-2], near[:, 1:-1], near[:, 2:]))
    return near, np.maximum.reduce((far[:, :-2], far[:, 1:-1], far[:, 2:]))
