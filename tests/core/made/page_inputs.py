"""The files that the documentation's pages name: one statue, its photos, the balls' photos, cameras, meshes, all small.

The statue is the bumpy ball, 0.3 units wide, 0.6 units before a camera with a lens of 50 mm, under three lights 30° off
the camera's axis.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import bumpy_ball
import mirror_ball
import numpy as np
from dng import mosaic, write_dng
from flat_weave import Weave
from surface_shapes import upright
from synthetic import named, write_file, write_parts

from mpsnet_core import Camera, NormalMap, near_rig, published_rig, write_camera, write_normals, write_rig
from mpsnet_core.estimate.registry import find_network
from mpsnet_core.io.image import linear_to_srgb

SIZE = (360, 300)
FOCAL = 50 / 36 * SIZE[0]
SCALE = 0.1
DISTANCE = 0.6
RIG = published_rig(30, 90)
ANGLES = [(30, 90), (30, 210), (30, 330)]


def make_inputs(folder: Path) -> None:
    """Write all of them into a folder."""
    statue_photos(folder)
    statue_meshes(folder)
    ball_photos(folder)
    many_views(folder)
    frames(folder)
    materials(folder)


def raw(path: Path, pixels: np.ndarray) -> None:
    write_dng(path, np.rint(np.clip(512 + mosaic(pixels) * 15000, 0, 16383)), black=512, white=16383)


def developed(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    write_file(path, linear_to_srgb(np.clip(pixels, 0, 1).astype(np.float32)), "uint8")


def camera(longitude: float, size: tuple[int, int] = SIZE) -> Camera:
    """It looks at the statue's middle from a side; z is up."""
    angle = np.radians(longitude)
    pose = np.eye(4)
    pose[:3, :3] = upright((np.cos(angle), np.sin(angle), 0.2))
    pose[:3, 3] = DISTANCE * pose[:3, 2]
    return Camera("perspective", *size, np.full(2, 50 / 36 * size[0]), None, pose)


def photographed(seen_by: Camera) -> bumpy_ball.Photo:
    pose = seen_by.world_from_camera.copy()
    pose[:3, 3] /= SCALE
    return bumpy_ball.photo(replace(seen_by, world_from_camera=pose))


def statue_photos(folder: Path) -> None:
    seen_by = camera(40)
    photo = photographed(seen_by)
    write_camera(folder / "camera.json", seen_by)
    write_rig(folder / "rig.json", RIG)
    lamps = [place for place, _ in mirror_ball.lamps_around((0, 0, -DISTANCE), 0.5, angles=ANGLES)]
    write_rig(folder / "near.json", near_rig(lamps, (0, 0, -DISTANCE)))
    raw(folder / "photo.dng", photo.image)
    write_normals(folder / "normals.png", NormalMap(photo.normals, photo.mask))
    passes = named("Normal.", "XYZ", photo.normals @ seen_by.rotation.T)
    passes |= named("Combined.", "RGBA", np.dstack([photo.image, photo.mask]))
    write_parts(folder / "true_normals.exr", [(None, passes)])
    single = [np.repeat(photo.image[..., light, None], 3, axis=-1) for light in range(3)]
    raw(folder / "white.dng", np.sum(single, axis=0) / 3)
    for light in range(3):
        for name in f"photo_{3 * light + 1}.png", f"photo_{light + 1}.jpg":
            developed(folder / name, single[light])
        developed(folder / f"white_{light + 1}.png", single[light])
    for name, value in (("dark", 0.002), ("flat", 0.5)):
        (folder / name).mkdir()
        for number in range(2):
            raw(folder / name / f"{number}.dng", np.full((*photo.mask.shape, 3), value))
    points = np.array([[5, 0, 1], [6, 7, 1], [8, -1, -6], [3, 8, 5], [9, 4, 6], [5, 9, -3]], float)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= SCALE * bumpy_ball.radius(points)[:, None]
    x, y, w = seen_by.projection_rows() @ np.c_[points, np.ones(len(points))].T
    pairs = [{"pixel": [x[n] / w[n], y[n] / w[n]], "point": points[n].tolist()} for n in range(len(points))]
    (folder / "pairs.json").write_text(json.dumps({"pairs": pairs}), encoding="utf-8")


def statue_meshes(folder: Path, rows: int = 60) -> None:
    mesh = bumpy_ball.mesh(rows)
    columns = 2 * rows
    row, column = np.divmod(mesh.triangles, columns)
    column = np.where(column < column.max(axis=1, keepdims=True) - 1, column + columns, column)
    uvs = 0.01 + 0.98 * np.stack([column / columns, 1 - row / rows], axis=-1)
    for name, middle in (("statue", 0.0), ("plinth", -0.2)):
        lines = [f"o {name.title()}", f"usemtl {'Stone' if name == 'plinth' else 'Bronze'}"]
        lines += [f"v {x:.6f} {y:.6f} {z + middle:.6f}" for x, y, z in SCALE * mesh.vertices]
        lines += [f"vt {u:.6f} {v:.6f}" for u, v in uvs.reshape(-1, 2)]
        for number, corners in enumerate(mesh.triangles):
            lines.append("f " + " ".join(f"{v + 1}/{3 * number + k + 1}" for k, v in enumerate(corners)))
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_file(folder / "statue_sculpted.png", np.full((64, 64, 3), (0.5, 0.5, 1)), "uint8")
    for name in ("meshes", "held_out"):
        (folder / name).mkdir()
        shutil.copy(folder / "statue.obj", folder / name)


def ball_photos(folder: Path) -> None:
    """Mirror and grey balls in the statue's place, and a grey card."""
    middle, radius = (0, 0, -DISTANCE), 0.1
    lamps = mirror_ball.lamps_around(middle, 20, angles=ANGLES)
    scene = mirror_ball.Scene([(middle, radius)], lamps, SIZE, FOCAL)
    raw(folder / "ball.dng", mirror_ball.photograph(scene))
    raw(folder / "grey.dng", mirror_ball.grey_photograph(scene, mirror_ball.CROSSTALK / 2, RIG.directions))
    for light, colour in enumerate(("red", "green", "blue")):
        developed(folder / f"{colour}.png", mirror_ball.photograph(scene, on=[light]))
        card = np.full((SIZE[1], SIZE[0], 3), 0.5 * mirror_ball.CROSSTALK[:, light])
        developed(folder / f"card_{colour}.png", card)
    square = np.zeros((SIZE[1], SIZE[0]))
    square[100:200, 100:200] = 1
    write_file(folder / "card.png", square, "uint8")
    ring = [(30, tilt) for tilt in range(90, 450, 40)]
    white = mirror_ball.Scene([(middle, radius)], mirror_ball.lamps_around(middle, 20, angles=ring), SIZE, FOCAL)
    for light in range(3):
        one = np.zeros((3, 3))
        one[:, light] = 0.3
        developed(folder / f"grey_{3 * light + 1}.png", mirror_ball.grey_photograph(scene, one, RIG.directions))
    for light in range(len(ring)):
        photo = mirror_ball.photograph(white, np.ones((3, len(ring))), on=[light])
        developed(folder / f"ball_{light + 1}.png", photo)

    near = mirror_ball.lamps_around(middle, 0.5, angles=ANGLES)
    places = [(-0.08, 0.0, -DISTANCE), (0.08, 0.02, -DISTANCE)]
    wide = (2 * SIZE[0], 2 * SIZE[1])
    for name, balls in (("two_balls", places), ("left", places[:1]), ("right", places[1:])):
        scene = mirror_ball.Scene([(place, 0.02) for place in balls], near, wide, 2 * FOCAL)
        developed(folder / f"{name}.png", mirror_ball.photograph(scene))
    scene = mirror_ball.Scene([(middle, 0.02)], near, wide, 2 * FOCAL)
    directions = [place - middle for place, _ in near] / np.float64(0.5)
    raw(folder / "near_grey.dng", mirror_ball.grey_photograph(scene, mirror_ball.CROSSTALK / 2, directions))


def many_views(folder: Path) -> None:
    """Three cameras as COLMAP's text model, their photos under the three lights and under white light."""
    size = (180, 150)
    (folder / "colmap").mkdir()
    focal = 50 / 36 * size[0]
    lens = f"1 PINHOLE {size[0]} {size[1]} {focal} {focal} {size[0] / 2} {size[1] / 2}\n"
    (folder / "colmap" / "cameras.txt").write_text(lens, encoding="utf-8")
    lines = []
    for number, longitude in enumerate((20, 50, 80), 1):
        seen_by = camera(longitude, size)
        photo = photographed(seen_by)
        developed(folder / "photos" / f"view_{number}.png", photo.image)
        developed(folder / "white" / f"view_{number}.png", np.repeat(photo.image.mean(-1, keepdims=True), 3, -1))
        # COLMAP's camera looks along +z, y down.
        turn = np.diag([1, -1, -1]) @ seen_by.rotation.T
        pose = [*quaternion(turn), *(-turn @ seen_by.world_from_camera[:3, 3])]
        lines += [f"{number} {' '.join(map(str, pose))} 1 view_{number}.png", ""]
    (folder / "colmap" / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def quaternion(turn: np.ndarray) -> list[float]:
    """(w, x, y, z) of a rotation that is no half turn."""
    w = np.sqrt(1 + np.trace(turn)) / 2
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (4 * w)
    return [w, *axis]


def frames(folder: Path) -> None:
    """Four frames as files with masks, and as a video."""
    import av

    (folder / "shots").mkdir()
    (folder / "masks").mkdir()
    with av.open(str(folder / "turn.mov"), "w") as video:
        stream = video.add_stream("png", rate=24)
        stream.width, stream.height = SIZE
        stream.pix_fmt = "rgb24"
        for number in range(1, 5):
            photo = photographed(camera(40 + number))
            developed(folder / "shots" / f"frame_{number:04d}.png", photo.image)
            write_file(folder / "masks" / f"mask_{number:04d}.png", photo.mask, "uint8")
            values = np.rint(255 * linear_to_srgb(np.clip(photo.image, 0, 1))).astype(np.uint8)
            video.mux(stream.encode(av.VideoFrame.from_ndarray(values, format="rgb24")))
        video.mux(stream.encode(None))


def materials(folder: Path) -> None:
    """The default network as if it were your own, a photo of cloth, and fits to materials that nobody measured."""
    shutil.copy(find_network("multiscale").path, folder / "multiscale.onnx")
    write_file(folder / "cloth.exr", Weave().capture().image, "float")
    random = np.random.default_rng(3)
    names = [f"material {number}" for number in range(10)]
    shapes = {"fc1": (6, 21), "b1": (21,), "fc2": (21, 21), "b2": (21,), "fc3": (21, 3), "b3": (3,)}
    values = {key: random.normal(0, 0.3, (len(names), *shape)).astype(np.float32) for key, shape in shapes.items()}
    for value in values.values():
        value[:6] *= 0.02  # grey and matt, as the paper's; in both parts of the materials
    values["b3"] += 0.5  # bright all over
    np.savez(folder / "fits.npz", names=np.array(names), **values)
    (folder / "npy").mkdir()
    for key, value in values.items():
        for name, one in zip(names, value, strict=True):
            np.save(folder / "npy" / f"{name}_{key}.npy", one)
