"""Meshes and views whose every normal is known without the core: spheres under any affine transform."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core import Camera, Mesh, NormalMap, View


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """(T, 3) two triangles for each square of a grid of points, counter-clockwise where rows go down."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def sphere_mesh(
    columns: int = 24, rows: int = 12, *, layout: str = "whole", world_from_object: np.ndarray | None = None
) -> Mesh:
    """A unit sphere of triangles with exact normals, its seam at -y and its poles at ±z.

    layout: "whole" spreads it over the texture; "mirrored" gives the half x < 0 the flipped UVs of a place of its own;
    "overlapping" lays that half, flipped, onto the other.
    """
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows, indexing="ij")
    azimuth, height = 2 * np.pi * u - np.pi / 2, np.pi * (v - 0.5)
    azimuth[-1] = azimuth[0]  # the seam's two sides are one place
    points = np.stack([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)], axis=-1)
    points[:, 0], points[:, -1] = (0, 0, -1), (0, 0, 1)
    squares = grid_triangles(*u.shape).reshape(columns, rows, 2, 3)
    # At the poles one triangle of each square has no area.
    triangles = np.concatenate([squares[:, 1:, 0], squares[:, :-1, 1]], axis=1).reshape(-1, 3)
    points, uvs = points.reshape(-1, 3), np.stack([u, v], axis=-1).reshape(-1, 2)[triangles]
    behind = points[triangles].mean(axis=1)[:, 0] < 0
    if layout == "mirrored":
        uvs[behind, :, 0] = 1.5 - uvs[behind, :, 0]
    elif layout == "overlapping":
        uvs[behind, :, 0] = 1 - uvs[behind, :, 0]
    uvs = 0.01 + 0.98 * uvs
    pose = np.eye(4) if world_from_object is None else world_from_object
    return Mesh(points, triangles, points[triangles], uvs, None, pose)


def upright(back: tuple[float, float, float]) -> np.ndarray:
    """(3, 3) the axes, as columns, of a camera that looks along -back."""
    z = np.array(back, float) / np.linalg.norm(back)
    x = np.cross((0, 0, 1) if abs(z[2]) < 0.9 else (0, 1, 0), z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def camera_looking(
    from_direction: tuple[float, float, float],
    projection: str = "orthographic",
    *,
    size: int = 256,
    distance: float = 4.0,
    target: tuple[float, float, float] = (0, 0, 0),
    reach: float = 1.1,
) -> Camera:
    """A camera that looks along -from_direction at `target` and frames `reach` around it."""
    pose = np.eye(4)
    pose[:3, :3] = upright(from_direction)
    pose[:3, 3] = np.array(target) + distance * pose[:3, 2]
    half = reach if projection == "orthographic" else reach / np.sqrt(distance**2 - reach**2)
    return Camera(projection, size, size, [size / 2 / half] * 2, None, pose)


def towards_camera(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(N, 3) unit vectors from points in the world to the camera."""
    if camera.projection == "orthographic":
        return np.broadcast_to(camera.world_from_camera[:3, 2], points.shape)
    towards = camera.world_from_camera[:3, 3] - points
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def first_on_sphere(origins: np.ndarray, towards: np.ndarray, world_from_object: np.ndarray) -> np.ndarray:
    """(N, 3) the point of the unit sphere, in object space, that a camera in direction `towards` sees on the line
    through `origins`; NaN where the line misses. The sphere stands in the world as `world_from_object` says."""
    inverse = np.linalg.inv(world_from_object)
    start = origins @ inverse[:3, :3].T + inverse[:3, 3]
    along = towards @ inverse[:3, :3].T
    a, b, c = (along**2).sum(1), (start * along).sum(1), (start**2).sum(1) - 1
    with np.errstate(invalid="ignore"):
        return start + along * ((-b + np.sqrt(b**2 - a * c)) / a)[:, None]


def sphere_view(camera: Camera, world_from_object: np.ndarray | None = None) -> View:
    """What a camera sees of the unit sphere: exact normals in camera space."""
    pose = np.eye(4) if world_from_object is None else world_from_object
    row, column = np.mgrid[: camera.height, : camera.width].reshape(2, -1) + 0.5
    focal = camera.focal[0]
    x, y = (column - camera.width / 2) / focal, (camera.height / 2 - row) / focal
    on_image = np.stack([x, y, -np.ones_like(x)], axis=1) @ camera.world_from_camera[:3, :3].T
    points = on_image + camera.world_from_camera[:3, 3]
    seen = first_on_sphere(points, towards_camera(camera, points), pose)
    normals = seen @ np.linalg.inv(pose[:3, :3]) @ camera.world_from_camera[:3, :3]
    mask = np.isfinite(normals).all(axis=1).reshape(camera.height, camera.width)
    vectors = np.nan_to_num(normals).reshape(*mask.shape, 3)
    return View(camera, NormalMap(vectors, mask))


@dataclass(frozen=True)
class Texels:
    """What lies under each covered texel, found one texel and triangle at a time.

    place: (N, 2) row and column. triangle: (N,). weights: (N, 3) barycentric coordinates.
    """

    place: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray

    def of(self, at_corners: np.ndarray) -> np.ndarray:
        """(N, K) what (T, 3, K) corner values are at the texels."""
        return np.einsum("nc,nck->nk", self.weights, at_corners[self.triangle])


def texels_of(uvs: np.ndarray, size: int) -> Texels:
    """Every texel's centre against every triangle whose bounds are near; of several, the last one holds it."""
    row, column = np.mgrid[:size, :size]
    centres = np.stack([(column + 0.5) / size, 1 - (row + 0.5) / size], axis=-1)
    triangle, weights = np.full((size, size), -1), np.zeros((size, size, 3))
    for number, (a, b, c) in enumerate(uvs.astype(np.float64)):
        area = _cross(b - a, c - a)
        if area == 0:
            continue
        corners = np.stack([a, b, c]) * [1, -1] + [0, 1]  # u and v from the top
        low, high = (np.clip(edge, 0, size).astype(int) for edge in _bounds(corners * size))
        near = np.s_[low[1] : high[1], low[0] : high[0]]
        middles = centres[near]
        inside = np.stack([_cross(end - start, middles - start) for start, end in ((b, c), (c, a), (a, b))], -1) / area
        held = (inside >= 0).all(axis=-1)
        triangle[near][held], weights[near][held] = number, inside[held]
    covered = triangle >= 0
    return Texels(np.stack([row[covered], column[covered]], axis=1), triangle[covered], weights[covered])


def _bounds(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(2,) the lowest and the highest whole numbers around (N, 2) points, and one more."""
    return np.floor(points.min(axis=0)) - 1, np.ceil(points.max(axis=0)) + 1


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
