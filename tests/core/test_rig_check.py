"""A rig that is not the photo's is noticed and named; the right one, and photos that do not tell, are not.

The photos are of a bumpy sphere, by equations that are independent of the measure.
"""

import logging
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from bumpy_sphere import bumpy_sphere
from synthetic import write_file

from mpsnet_core import LightRig, NormalMap, write_normals, write_rig
from mpsnet_core.capture.open import Source, open_captures
from mpsnet_core.io.image import Image
from mpsnet_core.scene.normal_directions import check_directions
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.scene.rig_check import check_rig

SIZE = 200
# Of no symmetry: no order of these lights is like a mirror image of theirs.
LIGHTS = direction_from_angles([30, 38, 34], [80, 190, 330])
ORDERS = list(permutations(range(3)))
MIRRORS = {"left to right": (-1, 1, 1), "top to bottom": (1, -1, 1), "180°": (-1, -1, 1)}


def bumpy_normals(size: int = SIZE) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) normals of a bumpy sphere that stands free in the picture, and its mask."""
    y, x = np.mgrid[1.2 : -1.2 : size * 1j, -1.2 : 1.2 : size * 1j]
    mask = x**2 + y**2 < 0.98
    points = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    normals = bumpy_sphere(points.reshape(-1, 3) + np.array([0, 0, 1e-9])).reshape(size, size, 3)
    return np.where(mask[..., None], normals, 0), mask


def photo_of(normals: np.ndarray, lights: np.ndarray, *, mixing: np.ndarray | None = None) -> np.ndarray:
    """A painted surface: two tones in patches, a highlight of each light, attached shadows, noise."""
    lit = np.maximum(normals @ lights.T, 0)
    halfway = lights + np.array([0, 0, 1])
    halfway = halfway / np.linalg.norm(halfway, axis=1, keepdims=True)
    gloss = 0.2 * np.maximum(normals @ halfway.T, 0) ** 40
    patches = np.where(
        np.sin(9 * normals[..., :1]) * np.sin(7 * normals[..., 1:2]) > 0, [0.8, 0.6, 0.4], [0.5, 0.5, 0.5]
    )
    image = 0.7 * (patches * lit + gloss * (lit > 0))
    image = image if mixing is None else image @ mixing.T
    return image + np.random.default_rng(2).normal(0, 0.003, image.shape)


@pytest.mark.parametrize("order", ORDERS)
def test_every_order_but_the_right_one_is_named(order: tuple[int, int, int]) -> None:
    normals, mask = bumpy_normals()
    fit = check_rig(photo_of(normals, LIGHTS), mask, LightRig(LIGHTS[list(order)]))
    assert bool(fit.better) == (order != (0, 1, 2))
    if fit.directions is None:
        assert fit.probability > 0.99
    else:
        np.testing.assert_allclose(fit.directions, LIGHTS, atol=1e-9)
    moved = [name for name, here, there in zip(("red", "green", "blue"), order, range(3), strict=True) if here != there]
    assert all(name in fit.better for name in moved)


@pytest.mark.parametrize("how", MIRRORS)
def test_mirrored_and_turned_lights_are_named(how: str) -> None:
    normals, mask = bumpy_normals()
    fit = check_rig(photo_of(normals, LIGHTS), mask, LightRig(LIGHTS * MIRRORS[how]))
    assert how in fit.better and fit.probability < 0.01
    np.testing.assert_allclose(fit.directions, LIGHTS, atol=1e-9)


def test_crosstalk_that_the_rig_does_not_state_is_no_wrong_order() -> None:
    normals, mask = bumpy_normals()
    crosstalk = np.full((3, 3), 0.2) + 0.6 * np.eye(3)
    assert not check_rig(photo_of(normals, LIGHTS, mixing=crosstalk), mask, LightRig(LIGHTS)).better


def flat() -> tuple[np.ndarray, np.ndarray]:
    normals = np.zeros((SIZE, SIZE, 3))
    normals[..., 2] = 1
    return normals, np.ones((SIZE, SIZE), bool)


def tiny() -> tuple[np.ndarray, np.ndarray]:
    return bumpy_normals(20)


@pytest.mark.parametrize("shape", [flat, tiny])
@pytest.mark.parametrize("order", ORDERS)
def test_photos_that_do_not_tell_are_not_blamed(shape, order) -> None:
    normals, mask = shape()
    assert not check_rig(photo_of(normals, LIGHTS), mask, LightRig(LIGHTS[list(order)])).better


@pytest.mark.parametrize("crop", [slice(0, None), slice(60, 140)], ids=["whole", "filling the photo"])
def test_of_a_photo_without_an_outline_a_half_turn_is_not_told(crop: slice) -> None:
    normals, mask = bumpy_normals()
    image = photo_of(normals, LIGHTS)[crop, crop]
    fit = check_rig(image, mask[crop, crop], LightRig(LIGHTS * (-1, -1, 1)))
    assert bool(fit.better) == (crop.start == 0)


def test_one_warning_a_set(caplog: pytest.LogCaptureFixture) -> None:
    normals, mask = bumpy_normals()
    image = Image(photo_of(normals, LIGHTS).astype(np.float32), mask.astype(np.float32), 1.0)
    photos = [Source(lambda: image, LightRig(LIGHTS[[1, 0, 2]]), name=name) for name in ("first", "second")]
    with caplog.at_level(logging.WARNING):
        assert len(list(open_captures(photos))) == 2
    (said,) = [message for message in caplog.messages if "[wrong-rig]" in message]
    assert said.startswith("first: ") and "swapped" in said


@pytest.mark.parametrize(
    ("turn", "words"),
    [
        (np.diag([1, -1]), "green"),
        (np.diag([-1, 1]), "red"),
        (np.diag([-1, -1]), "red and green"),
        (np.array([[0, 1], [1, 0]]), "exchanged"),
        (np.array([[0, -1], [1, 0]]), "exchanged"),
        (np.eye(2), None),
    ],
)
def test_a_map_with_wrong_channels_is_named(turn, words, caplog: pytest.LogCaptureFixture) -> None:
    normals, mask = bumpy_normals()
    normals[..., :2] = normals[..., :2] @ turn.T
    with caplog.at_level(logging.WARNING):
        check_directions(NormalMap(normals, mask), "normals.png")
    said = [message for message in caplog.messages if "[normal-directions]" in message]
    assert (len(said) == 1 and words in said[0]) if words else not said


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo with its mask, wrong rigs, and normal maps with green down and with z inverted; a camera and a mesh."""
    from mpsnet_core.scene.camera import Camera, write_camera

    folder = tmp_path_factory.mktemp("rig")
    normals, mask = bumpy_normals()
    image = photo_of(normals, LIGHTS).clip(0, 1)
    (folder / "photos").mkdir()
    for name in ("a.png", "b.png"):
        write_file(folder / "photos" / name, image, "uint16")
    write_file(folder / "mask.png", mask, "uint8")
    write_rig(folder / "swapped.json", LightRig(LIGHTS[[1, 0, 2]]))
    write_rig(folder / "right.json", LightRig(LIGHTS))
    write_normals(folder / "down.png", NormalMap(normals, mask), convention="directx")
    write_normals(folder / "behind.png", NormalMap(normals * [1, 1, -1], mask))
    pose = np.eye(4)
    pose[2, 3] = 5
    focal = np.full(2, SIZE / 2.4)
    write_camera(folder / "camera.json", Camera("orthographic", SIZE, SIZE, focal, np.full(2, SIZE / 2), pose))
    (folder / "square.obj").write_text(
        "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/3/1 4/4/1\n"
    )
    return folder


@pytest.mark.parametrize("photos", ["photos/a.png", "photos"])
@pytest.mark.parametrize("rig", ["right", "swapped"])
def test_estimate_warns_once(photos: str, rig: str, files: Path, tmp_path: Path, mpsnet) -> None:
    output = tmp_path / ("out" if photos == "photos" else "out.png")
    options = ["--rig", files / f"{rig}.json", "--mask", files / "mask.png", "--encoding", "linear", "-o", output]
    done = mpsnet("estimate", files / photos, *options, "--model", "lambertian")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("[wrong-rig]") == (rig == "swapped")


@pytest.mark.parametrize("rig", ["right", "swapped"])
def test_check_has_a_row_for_the_rig(rig: str, files: Path, mpsnet) -> None:
    options = ["--rig", files / f"{rig}.json", "--mask", files / "mask.png", "--encoding", "linear"]
    done = mpsnet("check", files / "photos" / "a.png", *options)
    (row,) = [line.split() for line in done.stdout.splitlines() if line.split()[1] == "rig"]
    assert row[0] == ("bad" if rig == "swapped" else "good")


def commands(files: Path, normals: str, output: Path) -> dict[str, list[object]]:
    """The commands that take a normal map in camera space."""
    return {
        "integrate": ["integrate", files / normals, "--height", output / "height.exr"],
        "bake": [
            *("bake", "--mesh", files / "square.obj", "--view", f"{files / 'camera.json'}={files / normals}"),
            *("--size", 64, "-o", output / "baked.png"),
        ],
    }


@pytest.mark.parametrize("command", ["integrate", "bake"])
def test_maps_in_another_frame_are_told_alike(command: str, files: Path, tmp_path: Path, mpsnet) -> None:
    down = mpsnet(*commands(files, "down.png", tmp_path)[command])
    assert down.returncode == 0 and down.stderr.count("[normal-directions]") == 1, down.stderr
    option = "--convention" if command == "integrate" else "--normals-convention"
    told = mpsnet(*commands(files, "down.png", tmp_path)[command], option, "directx")
    assert told.returncode == 0 and "[normal-directions]" not in told.stderr
    behind = mpsnet(*commands(files, "behind.png", tmp_path)[command])
    assert behind.returncode != 0 and "not in camera space" in behind.stderr
