"""COLMAP models written by hand, after https://colmap.github.io/format.html, and what is refused."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from colmap_files import SIZE, TEXT_CAMERAS, TRANSLATION, binary_cameras, binary_images, write_binary, write_text
from photogrammetry_scene import POINTS, TURN, Array, opencv, refusal, seen

from mpsnet_core.scene.photogrammetry import read_cameras

# Model, its number, its parameters in the file's order.
MODELS = {
    "SIMPLE_PINHOLE": (0, {"f": 500, "cx": 321.5, "cy": 238.25}),
    "PINHOLE": (1, {"fx": 500, "fy": 480, "cx": 321.5, "cy": 238.25}),
    "SIMPLE_RADIAL": (2, {"f": 500, "cx": 321.5, "cy": 238.25, "k1": -0.12}),
    "RADIAL": (3, {"f": 500, "cx": 321.5, "cy": 238.25, "k1": -0.12, "k2": 0.05}),
    "OPENCV": (4, {"fx": 500, "fy": 480, "cx": 321, "cy": 238, "k1": -0.1, "k2": 0.05, "p1": 0.004, "p2": -0.002}),
    "FULL_OPENCV": (
        6,
        {"fx": 500, "fy": 480, "cx": 321, "cy": 238, "k1": -0.1, "k2": 0.05, "p1": 0.004, "p2": -0.002}
        | {"k3": 0.02, "k4": 0.03, "k5": -0.01, "k6": 0.005},
    ),
}


def documented(x: Array, parameters: dict[str, float]) -> Array:
    """World points (N, 3) to pixels: the pose is world to camera, x right, y down, z forward."""
    x, y, z = (x @ TURN.T + TRANSLATION).T
    x, y = opencv(x / z, y / z, parameters)
    focal = parameters.get("f", 0)
    return np.stack(
        [parameters.get("fx", focal) * x + parameters["cx"], parameters.get("fy", focal) * y + parameters["cy"]], -1
    )


@pytest.mark.parametrize("kind", ["text", "binary"])
@pytest.mark.parametrize("model", MODELS)
def test_points_land_where_the_model_says(tmp_path: Path, model: str, kind: str) -> None:
    number, parameters = MODELS[model]
    if kind == "text":
        camera = f"3 {model} 640 480 " + " ".join(map(str, parameters.values()))
        write_text(tmp_path, camera + "\n", "1 0.8 0.2 -0.4 0.4 0.3 -0.2 6 3 a.jpg\n\n")
    else:
        write_binary(tmp_path, binary_cameras((3, number, *SIZE, tuple(parameters.values()))), binary_images("a.jpg"))
    (posed,) = read_cameras(tmp_path)
    assert (posed.camera.width, posed.camera.height) == SIZE
    np.testing.assert_allclose(seen(posed), documented(POINTS, parameters), atol=1e-9)
    assert posed.lens.is_identity == ("PINHOLE" in model)


def test_text_photos_come_by_name_with_their_own_cameras(tmp_path: Path) -> None:
    photos = read_cameras(write_text(tmp_path))
    assert [posed.photo for posed in photos] == ["a.jpg", "lit/b 2.jpg", "lit/c.jpg"]
    a, b, c = photos
    np.testing.assert_allclose(seen(b), documented(POINTS, MODELS["SIMPLE_RADIAL"][1]), atol=1e-9)
    # The identity looks along the world's +z with its y down; half a turn about x looks along -z, as ours do.
    np.testing.assert_array_equal(c.camera.rotation, np.diag([1, -1, -1]))
    np.testing.assert_array_equal(a.camera.rotation, np.eye(3))


def test_binary_photos_come_by_name_past_each_others_points(tmp_path: Path) -> None:
    write_binary(tmp_path, images=binary_images("c.jpg", "b.jpg", "größe/a.jpg", "d.jpg"))
    assert [posed.photo for posed in read_cameras(tmp_path)] == ["b.jpg", "c.jpg", "d.jpg", "größe/a.jpg"]


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "0", "."])
@pytest.mark.parametrize("write", [write_text, write_binary])
def test_a_project_leads_to_its_model(tmp_path: Path, place: str, write: Callable[[Path], Path]) -> None:
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    write(tmp_path / place)
    assert len(read_cameras(tmp_path)) == (3 if write is write_text else 2)


@pytest.mark.parametrize("given", [".", "sparse"])
def test_which_of_several_models_is_read_is_said(tmp_path: Path, given: str, caplog: pytest.LogCaptureFixture) -> None:
    for number in "01":
        (tmp_path / "sparse" / number).mkdir(parents=True)
        write_text(tmp_path / "sparse" / number)
    with caplog.at_level("INFO", "mpsnet_core"):
        read_cameras(tmp_path / given)
    assert "sparse holds several models; the first, 0, is read" in caplog.text


POSE = "1 0.8 0.2 -0.4 0.4 0.3 -0.2 6 3 a.jpg\n\n"


@pytest.mark.parametrize(
    ("cameras", "images", "said"),
    [
        ("3 OPENCV_FISHEYE 640 480 1 1 1 1 0 0 0 0", POSE, "cameras.txt: line 1: camera model OPENCV_FISHEYE"),
        ("3 PINHOLE 640 480 500 500 320", POSE, "PINHOLE has 4 parameters, here are 3"),
        ("3 PINHOLE 640 480 500 nan 320 240", POSE, "images.txt: line 1: the camera's focal"),
        ("3 SIMPLE_RADIAL 640 480 500 320 240 inf", POSE, "cameras.txt: line 1: the lens has a coefficient"),
        (TEXT_CAMERAS, POSE.replace("a.jpg", ""), "not IMAGE_ID QW QX QY QZ"),
        (TEXT_CAMERAS, POSE.replace("0.8", "nan"), "not a rotation"),
        (TEXT_CAMERAS, POSE.replace(" 3 a", " 9 a"), "its camera 9 is not in the file of cameras"),
        (TEXT_CAMERAS, POSE.strip() + "\n" + POSE.replace("a.", "b."), "line 2: not the points of the photo above"),
        (TEXT_CAMERAS, "\0\ufffe binary \1", "not IMAGE_ID"),
    ],
)
def test_bad_text_is_refused(tmp_path: Path, cameras: str, images: str, said: str) -> None:
    message = refusal(lambda: read_cameras(write_text(tmp_path, cameras, images)))
    assert said in message
    assert str(tmp_path) in message


CAMERA = binary_cameras((3, 0, 640, 480, (500.0, 321.5, 238.25)))
IMAGE = binary_images("a.jpg")


@pytest.mark.parametrize(
    ("cameras", "images", "said"),
    [
        (CAMERA[:-1], IMAGE, "cameras.bin: it is cut short"),
        (struct.pack("<Q", 2**60), IMAGE, "more than fit into it"),
        (binary_cameras((3, 5, 640, 480, (1.0,) * 8)), IMAGE, "camera model OPENCV_FISHEYE"),
        (binary_cameras((3, 0, 2**63, 480, (500.0, 1.0, 1.0))), IMAGE, "the camera's width"),
        (CAMERA, IMAGE[:-4], "images.bin: it is cut short"),
        (CAMERA, IMAGE[:-8] + struct.pack("<Q", 2**61), "more than fit into it"),
        (CAMERA, IMAGE[:72] + b"a" * 100, "a photo's name that does not end"),
        (CAMERA, binary_images("a.jpg", camera=4), "photo 'a.jpg': its camera 4 is not"),
        (CAMERA, binary_images("a.jpg", pose=(float("nan"), 0, 0, 0, 0, 0, 0)), "photo 'a.jpg': its quaternion"),
    ],
)
def test_bad_binary_is_refused(tmp_path: Path, cameras: bytes, images: bytes, said: str) -> None:
    message = refusal(lambda: read_cameras(write_binary(tmp_path, cameras, images)))
    assert said in message
    assert str(tmp_path) in message


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    assert "holds no COLMAP model" in refusal(lambda: read_cameras(tmp_path))
    assert "does not exist" in refusal(lambda: read_cameras(tmp_path / "nowhere"))
    (tmp_path / "points3D.bin").write_bytes(b"")
    assert "is no file of a COLMAP model" in refusal(lambda: read_cameras(tmp_path / "points3D.bin"))
    write_binary(tmp_path)
    (tmp_path / "images.bin").unlink()
    assert "images.bin does not exist" in refusal(lambda: read_cameras(tmp_path))
