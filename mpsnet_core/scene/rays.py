"""Ray casting against a triangle mesh in world space (embree)."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F32, F64, I32, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot
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
        weights: F32 = np.stack([1 - self.u - self.v, self.u, self.v], axis=1)[..., None]
        return weights

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
        occluded: Bools = found >= 0
        return occluded

    def hits(self, origins: Floats, directions: Floats) -> Hits:
        """Where rays from origins (N, 3) in unit directions (N, 3) first hit the mesh."""
        found = self._run(origins, directions, "DISTANCE", output=1)
        # On a miss, Embree returns its largest float, which would overflow when scaled.
        distance = np.where(found["primID"] < 0, np.float32(np.inf), found["tfar"]) * np.float32(self.size)
        return Hits(found["primID"], found["u"], found["v"], distance)

    def occluded(self, origins: Floats, directions: Floats) -> Bools:
        """(N,) whether rays from origins (N, 3) in unit directions (N, 3), or a common one (1, 3), hit anything."""
        occluded: Bools = self._run(origins, directions, "OCCLUDED") >= 0
        return occluded

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
