"""Ray casting against a triangle mesh in world space (embree)."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh

# embree's distance for rays that hit nothing is above this.
_NO_HIT = 1e30


@dataclass(frozen=True)
class Hits:
    """Where each ray first meets the mesh.

    triangle: (N,) int32, -1 where the ray hits nothing. u, v: (N,) float32 weights of the triangle's second and third
    corner; the first has 1 - u - v. distance: (N,) float32 along the ray, infinity where it hits nothing.
    """

    triangle: NDArray[np.int32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    distance: NDArray[np.float32]

    @property
    def weights(self) -> NDArray[np.float32]:
        """(N, 3, 1) barycentric coordinates."""
        weights: NDArray[np.float32] = np.stack([1 - self.u - self.v, self.u, self.v], axis=1)[..., None]
        return weights

    def chosen(self, which: NDArray[np.integer[Any]]) -> "Hits":
        """The hits of some of the rays, by their indices."""
        return Hits(self.triangle[which], self.u[which], self.v[which], self.distance[which])


class RayScene:
    """A mesh prepared for ray casting.

    vertices: (V, 3) in world space. triangles: (T, 3) vertex numbers.
    low, high, middle: (3,) of the mesh's bounding box; size: its diagonal.
    """

    def __init__(self, vertices: NDArray[np.floating[Any]], triangles: NDArray[np.integer[Any]]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        # embree works in float32: centred and scaled to about 1, it does not matter where the object stands.
        self.low, self.high = low, high = vertices.min(axis=0), vertices.max(axis=0)
        self.middle, self.size = (low + high) / 2, float(np.linalg.norm(high - low)) or 1.0
        self._scene = EmbreeScene()
        # embreex reads indices one by one, from tuples twice as fast as from an array's rows.
        corners = np.fromiter(zip(*triangles.T.tolist(), strict=True), object, len(triangles))
        self._mesh = TriangleMesh(self._scene, ((vertices - self.middle) / self.size).astype(np.float32), corners)

    @classmethod
    def of(cls, mesh: Mesh) -> "RayScene":
        """That of a mesh where it stands."""
        return cls(mesh.world_vertices, mesh.triangles)

    def rays_of(self, camera: Camera, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """World-space origins and unit directions, each (N, 3), of a camera's rays through image points (N, 2).

        And the distance by which they start before the camera: an orthographic one sees what is behind its plane as
        well, so its rays start outside the mesh.
        """
        origins, directions = camera.rays(points)
        if camera.projection == "perspective":
            return origins, directions, 0.0
        back = float(np.linalg.norm(camera.world_from_camera[:3, 3] - self.middle)) + self.size
        return origins - back * directions, directions, back

    def extent(self, camera: Camera) -> tuple[slice, slice]:
        """Rows and columns of the camera's image, at least one, outside which it does not see the mesh."""
        box = np.array(list(itertools.product(*zip(self.low, self.high, strict=True), [1.0])))
        x, y, w = camera.projection_rows() @ box.T
        if (w <= 0).any():  # some of it is beside or behind the camera
            return slice(0, camera.height), slice(0, camera.width)
        spans = []
        for place, length in ((y / w, camera.height), (x / w, camera.width)):
            # What lies half a pixel outside the image still counts, and rounding moves it by a little.
            start = int(np.clip(np.floor(place.min()) - 2, 0, length - 1))
            spans.append(slice(start, int(np.clip(np.ceil(place.max()) + 2, start + 1, length))))
        return spans[0], spans[1]

    def depth_of_middle(self, camera: Camera) -> float:
        """How far the mesh's middle is before the camera along its axis."""
        return float(camera.rotation[:, 2] @ (camera.world_from_camera[:3, 3] - self.middle))

    def depths(self, camera: Camera, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """(h, w) depth of the mesh in a camera's image at columns `x` (w,) and rows `y` (h,) in pixels; else infinity.

        It is along the camera's axis, from the mesh's middle on. An orthographic camera sees what is behind its plane.
        """
        depth = np.empty((len(y), len(x)), np.float32)
        right, up, ahead = (camera.rotation * (1.0, 1.0, -1.0)).T
        away = self.depth_of_middle(camera)
        flat = camera.projection == "orthographic"
        # The rays start close before the mesh, where float32 is fine enough, and are as long as they are deep.
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

    def distances(
        self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]
    ) -> NDArray[np.float64]:
        """(N,) distance along each ray to the first hit, infinity where it hits nothing. Unit directions (N, 3)."""
        found = np.asarray(self._run(origins, directions, "DISTANCE"), np.float64)
        return np.where(found > _NO_HIT, np.inf, found * self.size)

    def occluded_within(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], reach: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """(N,) whether rays (N, 3), from origins relative to the mesh's middle, hit anything within `reach` (N,)."""
        scale = np.float32(1 / self.size)
        start, farthest = np.multiply(origins, scale, order="C"), reach * scale
        found = self._scene.run(start, np.ascontiguousarray(directions), dists=farthest, query="OCCLUDED")
        occluded: NDArray[np.bool_] = found >= 0
        return occluded

    def hits(self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]) -> Hits:
        """Where rays (N, 3), with unit directions (N, 3), first meet the mesh."""
        found = self._run(origins, directions, "DISTANCE", output=1)
        # Where nothing is hit, its largest number stands, which no size may multiply.
        distance = np.where(found["primID"] < 0, np.float32(np.inf), found["tfar"]) * np.float32(self.size)
        return Hits(found["primID"], found["u"], found["v"], distance)

    def occluded(self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
        """(N,) whether rays (N, 3) hit anything; unit directions (N, 3), or (1, 3) for one that they share."""
        occluded: NDArray[np.bool_] = self._run(origins, directions, "OCCLUDED") >= 0
        return occluded

    def _run(
        self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]], query: str, **settings: int
    ) -> Any:
        middle = self.middle.astype(origins.dtype)
        start = np.ascontiguousarray((origins - middle) * origins.dtype.type(1 / self.size), np.float32)
        return self._scene.run(start, np.ascontiguousarray(directions, np.float32), query=query, **settings)


def lift_to_curve(
    lift: NDArray[np.floating[Any]],
    points: NDArray[np.floating[Any]],
    weights: Iterable[NDArray[np.floating[Any]]],
    corners: Iterable[NDArray[np.floating[Any]]],
    normals: Iterable[NDArray[np.floating[Any]]],
) -> None:
    """Add to `lift` (N, 3) what leads from points (N, 3) of triangles to the curved surface that the normals pretend.

    Rays that start there, not on the flat triangle below, are not in the shadow of its own neighbours (Hanika, Hacking
    the Shadow Terminator, 2021). weights (N, 1), corners (N, 3) and normals (N, 3): those of the three corners.
    """
    for weight, corner, normal in zip(weights, corners, normals, strict=True):
        below = np.minimum(dot(points - corner, normal), 0)
        lift -= (weight[:, 0] * below)[:, None] * normal
