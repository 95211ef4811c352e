"""Lights found in photos without a rig: an egg shaded by hand, turned, mirrored, under lights in another order."""

import json
import logging
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

from mpsnet_core import Estimate, GeometryError, SettingsError, Superpose, read_normals, read_rig, write_image
from mpsnet_core.estimate.lights.find import find_lights
from mpsnet_core.estimate.operations import CalibratePhoto

SIDE = 160
LIGHTS = np.array([[0.5, 0.3, 0.81], [-0.6, 0.35, 0.72], [0.1, -0.55, 0.83]])
LIGHTS /= np.linalg.norm(LIGHTS, axis=1, keepdims=True)


def egg() -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) normals of an egg, and its mask."""
    y, x = (0.5 * SIDE - np.mgrid[:SIDE, :SIDE] - 0.5) / (0.42 * SIDE)
    x = -x
    wide = 0.8 + 0.15 * y
    height = np.sqrt(np.maximum(1 - (x / wide) ** 2 - y**2, 0))
    normals = np.stack([x / wide**2, y - 0.15 * x**2 / wide**3, height], axis=-1)
    mask = height > 0.05
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9), mask


NORMALS, MASK = egg()
PHOTO = np.maximum(NORMALS @ LIGHTS.T, 0) * (0.8, 0.6, 0.7) * MASK[..., None]


def off(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((found * true).sum(axis=-1), -1, 1)))


def test_lights_are_within_twice_the_stated_error() -> None:
    found = find_lights([(PHOTO, MASK)])
    print(off(found.rig.directions, LIGHTS), found.errors)
    assert (off(found.rig.directions, LIGHTS) < 2 * found.errors).all()
    assert off(found.rig.directions, LIGHTS).mean() < 2.5


@pytest.mark.parametrize(
    ("change", "turn"),
    [
        (lambda photo: np.rot90(photo), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        (lambda photo: photo[:, ::-1], np.diag([-1, 1, 1])),
        (lambda photo: photo[::-1], np.diag([1, -1, 1])),
    ],
    ids=["turned", "mirrored", "upside down"],
)
def test_the_lights_turn_with_the_photo(change, turn) -> None:
    plain = find_lights([(PHOTO, MASK)]).rig.directions
    changed = find_lights([(change(PHOTO), change(MASK))]).rig.directions
    assert off(changed, plain @ np.transpose(turn)).max() < 4


def test_each_channel_has_its_light() -> None:
    order = [2, 0, 1]
    assert off(find_lights([(PHOTO[..., order], MASK)]).rig.directions, LIGHTS[order]).max() < 20


def files(folder: Path) -> Path:
    photo = np.concatenate([PHOTO, MASK[..., None]], axis=-1).astype(np.float32)
    write_image(folder / "photo.exr", photo)
    return folder / "photo.exr"


def test_an_estimate_needs_no_rig(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    photo = files(tmp_path)
    with caplog.at_level(logging.WARNING, "mpsnet_core"):
        made = Estimate(image=(str(photo),), output=str(tmp_path / "n.exr"), passes=1).run()
    assert "[lights-found]" in caplog.text
    assert made.lights is not None and [light.name for light in made.lights] == ["red", "green", "blue"]
    error = off(read_normals(tmp_path / "n.exr").vectors[MASK], NORMALS[MASK]).mean()
    print(error)
    assert error < 10


def test_a_rig_is_written_that_gives_the_same_normals(tmp_path: Path) -> None:
    photo = files(tmp_path)
    facts = tmp_path / "facts.json"
    CalibratePhoto(image=(str(photo),), output=str(tmp_path / "rig.json"), json=str(facts)).run()
    stated = [light["direction"] for light in json.loads(facts.read_text())["lights"]]
    assert read_rig(tmp_path / "rig.json").directions == pytest.approx(np.array(stated), abs=1e-3)
    for name, rig in (("with", str(tmp_path / "rig.json")), ("without", None)):
        Estimate(image=(str(photo),), rig=rig, model="lambertian", output=str(tmp_path / f"{name}.exr")).run()
    both = [read_normals(tmp_path / f"{name}.exr").vectors for name in ("with", "without")]
    assert both[0] == pytest.approx(both[1], abs=1e-4)


def test_photos_of_a_folder_share_their_lights(tmp_path: Path) -> None:
    for number in (1, 2):
        files(tmp_path).rename(tmp_path / f"frame_{number}.exr")
    (tmp_path / "frame_3.exr").write_bytes(b"damaged")
    made = Estimate(
        image=(str(tmp_path / "frame_#.exr"),), output=str(tmp_path / "out"), model="lambertian", format="exr"
    ).run()
    assert made.made == 2 and len(made.lights) == 3


def test_a_linear_png_that_does_not_say_so_has_the_same_lights(tmp_path: Path) -> None:
    write_image(tmp_path / "photo.png", np.concatenate([PHOTO, MASK[..., None]], axis=-1), bits=16)
    CalibratePhoto(image=(str(tmp_path / "photo.png"),), output=str(tmp_path / "png.json")).run()
    CalibratePhoto(image=(str(files(tmp_path)),), output=str(tmp_path / "exr.json")).run()
    found = [read_rig(tmp_path / name).directions for name in ("png.json", "exr.json")]
    assert off(*found).max() < 1


def test_three_photos_of_one_white_light_each_are_one_photo(tmp_path: Path) -> None:
    photos = [str(tmp_path / f"{name}.exr") for name in "abc"]
    for channel, photo in enumerate(photos):
        grey = np.concatenate([PHOTO[..., [channel] * 3] * (0.9, 0.5, 0.4), MASK[..., None]], axis=-1)
        write_image(photo, grey.astype(np.float32))
    Superpose(image=photos, channels=True, output=str(tmp_path / "photo.exr")).run()
    CalibratePhoto(image=(str(tmp_path / "photo.exr"),), output=str(tmp_path / "one.json")).run()
    CalibratePhoto(image=photos, per_light=True, output=str(tmp_path / "three.json")).run()
    rigs = [read_rig(tmp_path / name) for name in ("one.json", "three.json")]
    assert off(rigs[0].directions, rigs[1].directions).max() < 0.1
    assert off(rigs[1].directions, LIGHTS).max() < 5
    assert np.array_equal(rigs[1].mixing, np.eye(3))


@pytest.mark.parametrize("changed", [{"dark": "a.exr"}, {"image": ("a.exr", "b.exr")}])
def test_photos_of_one_light_each_that_make_none_are_refused(tmp_path: Path, changed: dict[str, object]) -> None:
    for name in "abc":
        files(tmp_path).rename(tmp_path / f"{name}.exr")
    options = {"image": ("a.exr", "b.exr", "c.exr"), "output": "rig.json", "per_light": True} | changed
    with chdir(tmp_path), pytest.raises(SettingsError):
        CalibratePhoto(**options).run()


@pytest.mark.parametrize("case", ["white", "tiny"])
def test_a_photo_that_tells_no_lights_is_refused(case: str) -> None:
    photo, mask = (
        (PHOTO.mean(axis=2, keepdims=True).repeat(3, axis=2), MASK) if case == "white" else (PHOTO, MASK & False)
    )
    if case == "tiny":
        mask = np.zeros_like(MASK)
        mask[80:84, 80:84] = True
    with pytest.raises(GeometryError, match="lights"):
        find_lights([(photo, mask)])
