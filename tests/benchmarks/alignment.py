"""How near ``mpsnet align`` comes to the camera that took a photo, of traced meshes, by the default network's normals.

    python tests/benchmarks/alignment.py MESH... [--views 2] [--size 1024]

Three ways for each view: from 8 pairs of points with 2 pixels of error, from a start 8 degrees, 8% of the object's size
and 8% of the focal length off, and without any start. Prints rotation, place across the picture as a share of the
object's size, and mean distance of the mesh's vertices in pixels of 1,024, and how many are within 0.3°, 0.3% and 1.5
pixels.
"""

import argparse
from pathlib import Path

import numpy as np

from mpsnet_core import Camera, Capture, NormalMap, published_rig, read_mesh
from mpsnet_core.arrays.unit_vectors import rotation_matrices
from mpsnet_core.estimate.alignment.points import USUAL_FOCAL, camera_from_points
from mpsnet_core.estimate.alignment.pose import MeshFaces, Poses, spread_rotations
from mpsnet_core.estimate.alignment.refine import PhotoPyramid, refine_camera
from mpsnet_core.estimate.alignment.search import search_cameras
from mpsnet_core.estimate.estimator import Estimator

BARS = np.array([0.3, 0.3, 1.5])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("--views", type=int, default=2)
    parser.add_argument("--size", type=int, default=1024)
    given = parser.parse_args()
    estimator = Estimator("multiscale", passes=1)
    found: dict[str, list[np.ndarray]] = {"pairs": [], "start": [], "search": []}
    for number, path in enumerate(given.meshes):
        mesh = read_mesh(path, shape_only=True)
        faces = MeshFaces.of(mesh)
        for view in range(given.views):
            rng = np.random.default_rng([number, view])
            camera = drawn_camera(rng, faces, mesh.world_vertices, given.size)
            evidence, surface = photographed(camera, faces, estimator)
            for way, errors in found.items():
                fit = aligned(way, rng, camera, evidence, surface, faces)
                errors.append(off(fit, camera, mesh.world_vertices, faces))
                print(f"{path.stem} {view + 1} {way:7}", "{:.2f}° {:.2f}% {:.2f} px".format(*errors[-1]), flush=True)
    for way, errors in found.items():
        within = (np.array(errors) < BARS).all(axis=1)
        medians = np.median(errors, axis=0)
        print(f"{way}: {within.sum()} of {len(within)} within; medians", "{:.2f}° {:.2f}% {:.2f} px".format(*medians))


def drawn_camera(rng: np.random.Generator, faces: MeshFaces, vertices: np.ndarray, size: int) -> Camera:
    """One that looks from anywhere, with a lens of 40 to 90 mm, and sees all of the mesh."""
    turn = spread_rotations(1000)[rng.integers(1000)]
    focal = size * rng.uniform(40, 90) / 36
    radius = np.linalg.norm(vertices - faces.scene.middle, axis=1).max()
    back = np.array([0, 0, -1.1 * radius * focal / (0.5 * size)])
    pose = Poses(turn[None], (back - turn @ faces.scene.middle)[None], np.array([focal]), np.full(2, size / 2))
    return pose.camera(size, size)


def photographed(camera: Camera, faces: MeshFaces, estimator: Estimator) -> tuple[NormalMap, np.ndarray]:
    """What the default network says of a photo of the mesh in matt grey, and points (N, 3) that the camera sees."""
    steps = np.arange(camera.width) + 0.5
    pixels = np.stack(np.broadcast_arrays(steps, steps[:, None]), axis=-1).reshape(-1, 2)
    origins, directions = camera.rays(pixels)
    hits = faces.scene.hits(origins, directions)
    seen = hits.triangle >= 0
    normals = faces.normals[hits.triangle[seen]]
    normals *= -np.sign((normals * directions[seen]).sum(axis=1, keepdims=True))
    points = origins[seen] + hits.distance[seen, None] * directions[seen]
    rig = published_rig(30, 90)
    image = np.zeros((len(pixels), 3), np.float32)
    for channel, light in enumerate(rig.directions @ camera.rotation.T):
        lit = ~faces.scene.occluded(points + 1e-3 * faces.scene.size * normals, light[None])
        image[seen, channel] = 0.6 * np.maximum(normals @ light, 0) * lit
    shape = camera.height, camera.width
    capture = Capture(image.reshape(*shape, 3), seen.reshape(shape), rig)
    return NormalMap(estimator(capture).vectors, capture.mask), points


def aligned(
    way: str, rng: np.random.Generator, camera: Camera, evidence: NormalMap, surface: np.ndarray, faces: MeshFaces
) -> Camera:
    if way == "search":
        lens = Camera("perspective", camera.width, camera.height, np.full(2, camera.width * USUAL_FOCAL))
        return search_cameras(PhotoPyramid(evidence), faces, lens)[0].camera
    if way == "pairs":
        points = surface[rng.choice(len(surface), 8, replace=False)]
        seen = np.c_[points, np.ones(8)] @ camera.projection_rows().T
        clicked = seen[:, :2] / seen[:, 2:] + rng.normal(size=(8, 2)) * np.sqrt(2) * camera.width / 1024
        start = camera_from_points(clicked, points, camera.width, camera.height).camera
        return refine_camera(PhotoPyramid(evidence), faces, start).camera
    poses = Poses.of(camera)
    axis = rng.normal(size=3)
    turned = rotation_matrices(np.radians(8) * axis[None] / np.linalg.norm(axis)) @ poses.rotation
    shift = rng.normal(size=3)
    shift *= 0.08 * faces.scene.size / np.linalg.norm(shift)
    middle = poses.in_camera(faces.scene.middle[None])[0, 0] + shift
    focal = poses.focal * 1.08 ** rng.choice([-1, 1])
    moved = Poses(turned, (middle - turned[0] @ faces.scene.middle)[None], focal, poses.centre)
    return refine_camera(PhotoPyramid(evidence), faces, moved.camera(camera.width, camera.height)).camera


def off(found: Camera, true: Camera, vertices: np.ndarray, faces: MeshFaces) -> np.ndarray:
    """Degrees, percent of the object's size across the picture at the object's distance, pixels of 1,024."""
    mine, other = Poses.of(found), Poses.of(true)
    cosine = (np.trace(mine.rotation[0].T @ other.rotation[0]) - 1) / 2
    pixels = np.linalg.norm(
        mine.projected(mine.in_camera(vertices)) - other.projected(other.in_camera(vertices)), axis=-1
    ).mean()
    here, there = (poses.in_camera(faces.scene.middle[None])[0, 0] for poses in (mine, other))
    across = np.linalg.norm(here[:2] / here[2] - there[:2] / there[2]) * abs(there[2]) / faces.scene.size
    return np.array([np.degrees(np.arccos(min(1, cosine))), 100 * across, pixels * 1024 / true.width])


if __name__ == "__main__":
    main()
