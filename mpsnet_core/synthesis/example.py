"""A small set of files to try every step with: photos of a carved stone egg, its scan, and what is true of it."""

from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import F64, I32
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.calibrate.ball import Ball, at_origin, mirrored
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.relief.surface_mesh import SurfaceMesh, write_surface_mesh
from mpsnet_core.scene.camera import Camera, camera_of_lens, write_camera
from mpsnet_core.scene.normal_map import NormalMap, write_normals
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material, Paint, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes.shape import smooth_shape

# What the files are.
FILES = {
    "photo.png": "a carved egg under red, green and blue light",
    "white.png": "the same under white light",
    "ball.png": "a mirror ball in its place",
    "egg.obj": "a scan of the egg, without the carving, with UVs",
    "camera.json": "where the camera was",
    "truth.png": "the true normals: mpsnet compare NORMALS --truth truth.png -o errors.png",
}
# What to type, and what it does.
COMMANDS = {
    "mpsnet estimate photo.png -o normals.png": "normals from the photo alone",
    "mpsnet integrate normals.png --relit relit.png": "see them under another light",
    "mpsnet calibrate lights ball.png --focal 50 -o rig.json": "the lights, from the mirror ball",
    "mpsnet estimate photo.png --rig rig.json --camera camera.json --white white.png -o better.png": "more accurate",
    "mpsnet bake --mesh egg.obj --view camera.json=better.png -o egg_normal.png": "onto the scan",
}

SIZE, FOCAL, DISTANCE = 512, 50.0, 2.9  # pixels, millimetres, radii of the object
LIGHTS = direction_from_angles([32, 38, 28], [80, 205, 325])
LAMP = 5.0  # the lamps' diameter as the object sees it, in degrees
ROOM = 0.02  # how bright the dark room is that the mirror ball shows
STONES = (Material(base_color=(0.42, 0.36, 0.3), roughness=0.5), Material(base_color=(0.3, 0.38, 0.4), roughness=0.7))
# Bumps of the egg: direction, height, narrowness.
BUMPS = np.array(
    [(0.7, 0.3, 0.6, 0.16, 5.0), (-0.7, 0.5, 0.5, 0.12, 9.0), (0.2, -0.8, 0.6, 0.1, 12.0), (0, 0, -1, 0.2, 3)]
)
FINE, COARSE = 220, 40  # rows of the mesh that is photographed, and of the scan
LEAVES, RINGS, CARVED = 9, 13, 0.02


def write_example(folder: Path) -> None:
    """Write the files that FILES names into a folder. The same program writes the same files."""
    pose = np.eye(4)
    pose[2, 3] = DISTANCE
    lens = camera_of_lens(FOCAL, SIZE, SIZE)
    camera = Camera(lens.projection, SIZE, SIZE, lens.focal, lens.centre, pose)
    sample = photographed(camera)
    photo = np.stack([sample.lights[light, ..., light] for light in range(3)], axis=-1)
    white = sample.lights.mean(axis=0)
    lit = {name: values / np.percentile(values, 99.95) for name, values in (("photo", photo), ("white", white))}
    for name, values in {**lit, "ball": ball_photo(camera)}.items():
        developed = linear_to_srgb(np.clip(values, 0, 1))
        write_image(folder / f"{name}.png", developed, bits=8, color_space="sRGB")
    write_surface_mesh(folder / "egg.obj", scanned(), up="y")  # the axes stay those of the camera's world
    write_camera(folder / "camera.json", camera)
    write_normals(folder / "truth.png", NormalMap(sample.normals, sample.mask), bits=8)


def photographed(camera: Camera) -> Sample:
    """What the camera sees of the egg under each light alone."""
    recipe = SceneDescription(
        seed=0,
        number=0,
        shape={},
        rotation=np.eye(3),
        camera=camera,
        light_directions=LIGHTS,
        light_sizes=np.full(3, LAMP),
        materials=STONES,
        pattern=Pattern("noise", scale=2.0, softness=0.3),
        paint=Paint(amount=0.2, scale=4.0),
    )
    egg, _ = surface(FINE, CARVED)
    return synthesise(recipe, smooth_shape(*egg), [load_reflectance(stone) for stone in STONES])


def surface(rows: int, carved: float) -> tuple[tuple[F64, I32], F64]:
    """The egg as a mesh over longitude and latitude: vertices (V, 3) and triangles (T, 3), and UVs (V, 2).

    carved: depth of the leaves that the scan does not have. The first and the last longitude are one seam.
    """
    v, u = np.mgrid[0 : 1 : (rows + 1) * 1j, 0 : 1 : (2 * rows + 1) * 1j]
    polar, turn = np.pi * (1 - v), 2 * np.pi * u
    ways = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), -np.sin(polar) * np.cos(turn)], axis=-1)
    bumps = (BUMPS[:, 3] * np.exp(BUMPS[:, 4] * (ways @ normalised(BUMPS[:, :3]).T - 1))).sum(axis=-1)
    leaf = np.abs(np.sin(LEAVES * turn / 2 + RINGS * polar / 2) * np.sin(LEAVES * turn / 2 - RINGS * polar / 2))
    radius = 0.72 + bumps + carved * np.minimum(leaf, 0.5) * np.sin(polar) ** 2
    places = (radius[..., None] * ways * (0.85, 1, 0.85)).reshape(-1, 3)
    row, column = np.mgrid[0:rows, 0 : 2 * rows].reshape(2, -1)
    corner = row * (2 * rows + 1) + column
    a, b, c, d = corner, corner + 1, corner + 2 * rows + 2, corner + 2 * rows + 1
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)]).astype(np.int32)
    return (places, triangles), np.stack([u, v], axis=-1).reshape(-1, 2)


def scanned() -> SurfaceMesh:
    """The egg as a scan shows it: coarse, without the leaves, and with UVs."""
    (places, triangles), uvs = surface(COARSE, 0.0)
    shape = smooth_shape(places, triangles)
    normals = np.zeros(places.shape, np.float32)
    normals[triangles] = shape.corner_normals
    return SurfaceMesh(places, triangles, normals, uvs.astype(np.float32))


def ball_photo(camera: Camera) -> F64:
    """(H, W, 3) a mirror ball in the egg's place: the dark room, and each lamp in its own channel."""
    ball = Ball(np.array([0, 0, -DISTANCE]), 0.6, camera, 0.0, 1.0, np.zeros((3, 3)))
    row, column = np.mgrid[0 : 2 * SIZE, 0 : 2 * SIZE].reshape(2, -1)
    pixels = (np.stack([column, row], axis=-1) + 0.5) / 2
    _, away = at_origin(camera).rays(pixels)
    on_ball = np.linalg.norm(np.cross(away, ball.centre), axis=-1) < ball.radius
    _, ways = mirrored(ball, pixels[on_ball])
    seen = ways @ LIGHTS.T > np.cos(np.radians(LAMP / 2))
    walls = ROOM * (0.3 + 0.3 * (ways[:, 1:2] > -0.2) + 0.2 * (np.abs(ways[:, :1] - 0.3) < 0.1))
    shown = np.full((len(pixels), 3), 2 * ROOM)
    shown[on_ball] = seen + walls
    return shown.reshape(SIZE, 2, SIZE, 2, 3).mean(axis=(1, 3))
