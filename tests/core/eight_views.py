"""Eight photos of a bumpy sphere whose every normal is known from calculus, with what goes wrong on a real table.

The mesh to bake onto is a smooth sphere of few triangles, as photogrammetry gives it: the right shape, no detail.
"""

from dataclasses import dataclass

import numpy as np
from surface_shapes import Texels, camera_looking, first_on_sphere, sphere_mesh, texels_of, towards_camera

from mpsnet_core.camera import Camera
from mpsnet_core.rig import published_rig

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def bumpy_normals(points: np.ndarray, waves: float = 30.0, height: float = 0.35) -> np.ndarray:
    """(N, 3) unit normals at points (N, 3) of the unit sphere whose radius is 1 + h(p), to first order in h.

    They are p less h's gradient along the sphere; h is a sum of products of sines, `waves` radians a unit.
    """
    x, y, z = (waves * points).T
    gradient = height * np.stack(
        [np.cos(x + 1) * np.sin(y), np.sin(x + 1) * np.cos(y) + np.cos(y) * np.sin(z), np.cos(z) * np.sin(y)], axis=1
    )
    gradient -= (gradient * points).sum(axis=1, keepdims=True) * points
    return unit(points - gradient)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def turn(axis: np.ndarray, degrees: float) -> np.ndarray:
    """(3, 3) rotation about an axis, by the matrix exponential's closed form."""
    x, y, z = unit(np.asarray(axis, float))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclass(frozen=True)
class Shot:
    """One photo. camera: as it is believed to be. image: linear, under the published rig. points: (H, W, 3) of the
    sphere, in the world. normals: (H, W, 3) true ones in the space of the camera as it truly was."""

    camera: Camera
    image: np.ndarray
    mask: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def shot(
    corner: tuple[float, float, float],
    size: int,
    rng: np.random.Generator,
    *,
    noise: float,
    off: float,
    reach: float = 1.1,
) -> Shot:
    """The sphere seen from a corner of the cube. off: degrees that the believed camera is turned about the sphere's
    middle and, as many hundredths of a radius for each degree, moved. reach: half the picture's width, in radii."""
    camera = camera_looking(corner, "perspective", size=size, distance=5.0, reach=reach)
    row, column = np.mgrid[:size, :size].reshape(2, -1) + 0.5
    middle = camera.world_from_camera[:3, 3]
    along = np.stack([(column - size / 2) / camera.focal[0], (size / 2 - row) / camera.focal[0], -np.ones_like(row)], 1)
    on_image = middle + along @ camera.rotation.T
    points = first_on_sphere(on_image, towards_camera(camera, on_image), np.eye(4))
    mask = np.isfinite(points).all(axis=1)
    points = np.nan_to_num(points)
    points[~mask] = (0, 0, 1)
    normals = bumpy_normals(points) @ camera.rotation
    image = np.maximum(normals @ published_rig().directions.T, 0) * 0.7
    image = np.maximum(image + noise * rng.normal(size=image.shape), 0)
    pose = camera.world_from_camera.copy()
    wrong = turn(rng.normal(size=3), off)
    pose[:3, :3] = wrong @ pose[:3, :3]
    pose[:3, 3] = wrong @ pose[:3, 3] + 0.01 * off * unit(rng.normal(size=3))
    believed = Camera("perspective", size, size, camera.focal, None, pose)
    grid = (size, size)
    return Shot(
        believed, image.reshape(*grid, 3), mask.reshape(grid), points.reshape(*grid, 3), normals.reshape(*grid, 3)
    )


def smoothly_wrong(normals: np.ndarray, points: np.ndarray, rng: np.random.Generator, degrees: float) -> np.ndarray:
    """Unit normals (H, W, 3) turned by a smooth field, about `degrees` of it, as networks err: each view otherwise."""
    waves, phases = rng.normal(size=(3, 3)), rng.uniform(0, 2 * np.pi, 3)
    field = np.sin(points @ waves.T * 1.2 + phases)
    angle = np.radians(degrees) * field / np.sqrt(1.5)
    # First-order turns are enough to be wrong by.
    return unit(normals + np.cross(angle, normals))


def borders(texels: Texels, size: int, cameras: list[Camera], mesh_points: np.ndarray, views: np.ndarray) -> np.ndarray:
    """(S, S) an integer for each texel that changes wherever the leading view does, or the number of views; -1 outside.

    On a sphere the leading view is the one that looks most squarely, known without the bake.
    """
    facing = np.stack([(towards_camera(camera, mesh_points) * unit(mesh_points)).sum(axis=1) for camera in cameras])
    label = np.full((size, size), -1)
    place = tuple(texels.place.T)
    label[place] = facing.argmax(axis=0) * 64 + views[place]
    return label


def sphere_texels(size: int, columns: int = 48, rows: int = 24) -> tuple[Texels, np.ndarray]:
    """Covered texels of :func:`sphere_mesh`, and the points (N, 3) of the unit sphere straight above them."""
    mesh = sphere_mesh(columns, rows)
    texels = texels_of(mesh.uvs, size)
    return texels, unit(texels.of(mesh.vertices[mesh.triangles]))
