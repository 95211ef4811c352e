"""Ray casting against a triangle mesh in world space (embree)."""

import itertools
import logging
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.resampling import chosen_pixels, reduced_shape
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh

# Embree's distance for rays that hit nothing is above this.
_NO_HIT = 1e30


@dataclass(frozen=True)
class Hits:
    """Where each ray first hits the mesh."""

    triangle: I32
    """(N,) int32. The triangle; -1 if the ray hits nothing."""
    u: F32
    """(N,) float32. Barycentric weight of the triangle's second corner; the first has 1 - u - v."""
    v: F32
    """(N,) float32. Barycentric weight of its third corner."""
    distance: F32
    """(N,) float32. Distance along the ray; infinity if it hits nothing."""

    @property
    def weights(self) -> F32:
        """(N, 3, 1) barycentric coordinates."""
        return np.stack([1 - self.u - self.v, self.u, self.v], axis=1)[..., None]

    def subset(self, which: NDArray[np.integer[Any]]) -> "Hits":
        """The hits of the rays with these indices."""
        return Hits(self.triangle[which], self.u[which], self.v[which], self.distance[which])


class RayScene:
    """A mesh prepared for ray casting.

    vertices: (V, 3) in world space. triangles: (T, 3) vertex indices.
    low, high, middle: (3,) corners and centre of the mesh's bounding box. size: its diagonal.
    """

    def __init__(self, vertices: Floats, triangles: NDArray[np.integer[Any]]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        # Embree works in float32: centring and scaling make the precision independent of the object's position.
        self.low, self.high = low, high = vertices.min(axis=0), vertices.max(axis=0)
        self.middle, self.size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
        self._scene = EmbreeScene()
        # embreex reads indices one by one, from tuples twice as fast as from an array's rows.
        corners = np.fromiter(zip(*triangles.T.tolist(), strict=True), object, len(triangles))
        self._mesh = TriangleMesh(self._scene, ((vertices - self.middle) / self.size).astype(np.float32), corners)

    @classmethod
    def of(cls, mesh: Mesh) -> "RayScene":
        """The scene of a mesh in world space."""
        return cls(mesh.world_vertices, mesh.triangles)

    def rays_of(self, camera: Camera, points: ArrayLike) -> tuple[F64, F64, float]:
        """World-space origins and unit directions, each (N, 3), of a camera's rays through image points (N, 2).

        Also the distance by which the origins are moved back from the camera: an orthographic camera sees what is
        behind its plane, too, so its rays must start outside the mesh.
        """
        origins, directions = camera.rays(points)
        if camera.projection == "perspective":
            return origins, directions, 0.0
        back = float(np.linalg.norm(camera.world_from_camera[:3, 3] - self.middle)) + self.size
        return origins - back * directions, directions, back

    def extent(self, camera: Camera) -> tuple[slice, slice]:
        """Rows and columns of the camera's image that bound the mesh, as :meth:`Camera.extent` finds them."""
        return camera.extent(np.array(list(itertools.product(*zip(self.low, self.high, strict=True)))))

    def depth_of_middle(self, camera: Camera) -> float:
        """Depth of the mesh's centre in front of the camera, along its axis."""
        return float(camera.rotation[:, 2] @ (camera.world_from_camera[:3, 3] - self.middle))

    def depths(self, camera: Camera, x: Floats, y: Floats) -> F32:
        """(h, w) depth of the mesh in a camera's image at columns `x` (w,) and rows `y` (h,) in pixels.

        Depth is along the camera's axis, relative to the mesh's centre; infinity where there is no surface. An
        orthographic camera sees what is behind its plane, too.
        """
        depth = np.empty((len(y), len(x)), np.float32)
        right, up, ahead = (camera.rotation * (1.0, 1.0, -1.0)).T
        away = self.depth_of_middle(camera)
        flat = camera.projection == "orthographic"
        # Rays start just in front of the mesh, where float32 is precise enough. Directions have unit depth, so that the
        # distance along a ray is its depth.
        start = away - self.size if flat else max(away - self.size, 0.0)
        eye = camera.world_from_camera[:3, 3] - self.middle
        across, down = (x - camera.centre[0]) / camera.focal[0], (camera.centre[1] - y) / camera.focal[1]

        def trace(rows: slice) -> None:
            origins, directions = np.empty((2, rows.stop - rows.start, len(x), 3), np.float32)
            for axis in range(3):
                sideways, steps = right[axis] * across, up[axis] * down[rows, None]
                if flat:
                    first = (eye[axis] + start * ahead[axis] + steps) / self.size
                    np.add(sideways / self.size, first, out=origins[..., axis], casting="same_kind")
                    directions[..., axis] = ahead[axis]
                else:
                    np.add(sideways, steps + ahead[axis], out=directions[..., axis], casting="same_kind")
                    share = start / self.size
                    first = eye[axis] / self.size + share * (steps + ahead[axis])
                    np.add(share * sideways, first, out=origins[..., axis], casting="same_kind")
            found = self._scene.run(origins.reshape(-1, 3), directions.reshape(-1, 3), query="DISTANCE")
            found[found > _NO_HIT] = np.inf
            found *= np.float32(self.size)
            np.add(found.reshape(-1, len(x)), np.float32(start - away), out=depth[rows])

        on_all_cores(trace, bands(len(y)))
        return depth

    def distances(self, origins: Floats, directions: Floats) -> F64:
        """(N,) distance along each ray, with unit direction (N, 3), to its first hit; infinity if it hits nothing."""
        found = np.asarray(self._run(origins, directions, "DISTANCE"), np.float64)
        return np.where(found > _NO_HIT, np.inf, found * self.size)

    def occluded_within(self, origins: F32, directions: F32, reach: F32) -> Bools:
        """(N,) whether rays from origins (N, 3), relative to the mesh's centre, hit anything within `reach` (N,)."""
        scale = np.float32(1 / self.size)
        start, farthest = np.multiply(origins, scale, order="C"), reach * scale
        found = self._scene.run(start, np.ascontiguousarray(directions), dists=farthest, query="OCCLUDED")
        return found >= 0

    def hits(self, origins: Floats, directions: Floats) -> Hits:
        """Where rays from origins (N, 3) in unit directions (N, 3) first hit the mesh."""
        found = self._run(origins, directions, "DISTANCE", output=1)
        # On a miss, Embree returns its largest float, which would overflow when scaled.
        distance = np.where(found["primID"] < 0, np.float32(np.inf), found["tfar"]) * np.float32(self.size)
        return Hits(found["primID"], found["u"], found["v"], distance)

    def occluded(self, origins: Floats, directions: Floats) -> Bools:
        """(N,) whether rays from origins (N, 3) in unit directions (N, 3), or a common one (1, 3), hit anything."""
        return self._run(origins, directions, "OCCLUDED") >= 0

    def _run(self, origins: Floats, directions: Floats, query: str, **settings: int) -> Any:
        middle = self.middle.astype(origins.dtype)
        start = np.ascontiguousarray((origins - middle) * origins.dtype.type(1 / self.size), np.float32)
        return self._scene.run(start, np.ascontiguousarray(directions, np.float32), query=query, **settings)


def lift_to_curve(
    lift: Floats, points: Floats, weights: Iterable[Floats], corners: Iterable[Floats], normals: Iterable[Floats]
) -> None:
    """Add to `lift` (N, 3) the offsets from points (N, 3) on triangles to the curved surface that their normals imply.

    Rays that start there and not on the flat triangle are not shadowed by its neighbours (Hanika, Hacking the Shadow
    Terminator, 2021). weights (N, 1), corners (N, 3), normals (N, 3): one of each for each of the three corners.
    """
    for weight, corner, normal in zip(weights, corners, normals, strict=True):
        below = np.minimum(dot(points - corner, normal), 0)
        lift -= (weight[:, 0] * below)[:, None] * normal


# ----------------------------------------------------------------------------------------------------------------------
# A mesh seen through a camera's pixels: the points that rays hit, and interpolated values there.


@dataclass(frozen=True)
class MeshHits:
    """The hits of a camera's rays through N pixels on a mesh."""

    mesh: Mesh
    """The mesh."""
    camera: Camera
    """The camera."""
    hit: I64
    """(M,). Indices of the pixels whose rays hit the mesh."""
    triangle: I32
    """(M,). Triangles that they hit."""
    weights: F32
    """(M, 3, 1). Barycentric coordinates of the hits."""
    points: F64
    """(M, 3). The hits in world space, relative to the scene's centre."""
    directions: F64
    """(M, 3). Unit directions of the rays, in camera space."""

    def at(self, corners: Floats) -> NDArray[Any]:
        """(M, K) values at the hits, interpolated from those at the triangles' corners, (T, 3, K)."""
        return (corners[self.triangle] * self.weights).sum(axis=1)

    def in_camera(self, normals: F32) -> F32:
        """(M, 3) unit normals in camera space from normals (M, 3) in object space."""
        to_camera = self.mesh.normals_to_world @ self.camera.rotation
        return normalised(normals @ to_camera.astype(np.float32))

    @property
    def from_front(self) -> Bools:
        """(M,) whether the triangles' outsides face the camera."""
        return dot(self.mesh.outwards[self.triangle] @ self.camera.rotation, self.directions) < 0


def mesh_hits(mesh: Mesh, camera: Camera, scene: RayScene, pixels: Floats) -> MeshHits:
    """Cast a camera's rays through pixels (N, 2) onto the mesh. scene: of the same mesh."""
    origins, directions, _ = scene.rays_of(camera, pixels)
    hits = scene.hits(origins, directions)
    hit = np.flatnonzero(hits.triangle >= 0)
    hits = hits.subset(hit)
    points = origins[hit] - scene.middle + directions[hit] * hits.distance[:, None]
    return MeshHits(mesh, camera, hit, hits.triangle, hits.weights, points, directions[hit] @ camera.rotation)


# ----------------------------------------------------------------------------------------------------------------------
# Depth maps of meshes, and masks of what a camera sees of them.


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
        raise GeometryError("the camera does not see the mesh; check that both share a world and it faces the mesh")
    return depth


def mesh_mask(camera: Camera, scene: RayScene) -> Bools:
    """(H, W) bool: the pixels in which the camera sees the mesh. Large images are sampled in blocks of a few pixels."""
    small = reduced_shape(camera.height, camera.width, MASK_PIXELS)
    rows, columns = chosen_pixels(*small, camera.height, camera.width)
    pixels = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), axis=-1).reshape(-1, 2)
    origins, directions, _ = scene.rays_of(camera, pixels)
    seen = np.isfinite(scene.distances(origins, directions)).reshape(small)
    return seen[np.ix_(*chosen_pixels(camera.height, camera.width, *small))]


# ----------------------------------------------------------------------------------------------------------------------
# Which points of a mesh a camera sees.


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
            highest = depth + SHARPEST_BEND * pixel + np.float32(2 * self.offset)
            self.planes[..., 0] = np.where(smooth, highest, np.float32(np.nan))
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
