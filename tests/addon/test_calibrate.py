"""Calibrating real lights in the panel: from photos of balls to a rig that the estimate uses."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from mpsnet_core.images import write_image
from mpsnet_core.rig import LightRig, direction_from_angles, read_rig, write_rig

SLANTS, TILTS = [35.0, 50.0, 42.0], [80.0, 200.0, 320.0]
LIGHTS = direction_from_angles(SLANTS, TILTS)
MIXING = np.array([[1.0, 0.2, 0.1], [0.25, 0.9, 0.15], [0.05, 0.3, 0.8]])


def balls_normals(size: int, radius: float, fine: int) -> tuple[np.ndarray, np.ndarray]:
    """(fine·size, fine·size, 3) normals of a ball in the middle, seen from afar, and where it is."""
    x = (np.arange(size * fine) + 0.5) / fine - size / 2
    x, y = np.meshgrid(x / radius, -x / radius)
    inside = x**2 + y**2 < 1
    return np.stack([x, y, np.sqrt(np.where(inside, 1 - x**2 - y**2, 0))], axis=-1), inside


def averaged(picture: np.ndarray, fine: int) -> np.ndarray:
    size = len(picture) // fine
    return picture.reshape(size, fine, size, fine, -1).mean(axis=(1, 3)).astype(np.float32)


@pytest.fixture
def mirror(tmp_path: Path) -> str:
    """A dim mirror ball before a brighter wall, with three coloured highlights."""
    normals, inside = balls_normals(300, 110, 3)
    reflected = 2 * normals[..., 2:] * normals - [0, 0, 1]
    picture = np.where(inside[..., None], 0.05, 0.15) * np.ones(3)
    for light, colour in zip(LIGHTS, MIXING.T, strict=True):
        picture[inside & (reflected @ light > np.cos(np.radians(3)))] += 0.7 * colour
    write_image(tmp_path / "mirror.exr", averaged(picture, 3))
    return str(tmp_path / "mirror.exr")


@pytest.fixture
def grey(tmp_path: Path) -> str:
    normals, inside = balls_normals(300, 110, 2)
    picture = 0.6 * np.maximum(normals @ LIGHTS.T, 0) @ MIXING.T
    write_image(tmp_path / "grey.exr", averaged(np.where(inside[..., None], picture, 0.001), 2))
    return str(tmp_path / "grey.exr")


def test_lights_and_mixing_are_found_and_used_from_then_on(scene, tmp_path, mirror, grey):
    bpy.ops.mps.calibrate_lights(ball=mirror, output=str(tmp_path / "rig.json"))
    calibrate = scene.mps.calibrate
    rows = [line.split("|") for line in calibrate.told.splitlines()]
    assert [row[0] for row in rows] == ["Red", "Green", "Blue"]
    assert calibrate.image is not None and min(calibrate.image.size) > 100
    assert Path(scene.mps.estimate.rig_file) == tmp_path / "rig.json"
    found = read_rig(tmp_path / "rig.json")
    assert np.degrees(np.arccos(np.clip((found.directions * LIGHTS).sum(axis=1), -1, 1))).max() < 1

    bpy.ops.mps.calibrate_mixing(grey=grey, output=str(tmp_path / "rig.json"))
    mixed = read_rig(tmp_path / "rig.json")
    np.testing.assert_allclose(mixed.directions, found.directions, atol=1e-6)
    np.testing.assert_allclose(mixed.mixing, MIXING, atol=0.03)
    assert len(calibrate.told.splitlines()) == 3


def test_a_circle_drawn_by_hand_is_taken(scene, tmp_path, mirror):
    bpy.ops.mps.calibrate_lights(
        ball=mirror, circle_x=150, circle_y=150, circle_radius=110, output=str(tmp_path / "rig.json")
    )
    found = read_rig(tmp_path / "rig.json")
    assert np.degrees(np.arccos(np.clip((found.directions * LIGHTS).sum(axis=1), -1, 1))).max() < 1


def test_what_is_missing_is_told(scene, tmp_path, mirror, grey):
    with pytest.raises(RuntimeError, match="no photo of the mirror ball is named"):
        bpy.ops.mps.calibrate_lights()
    with pytest.raises(RuntimeError, match="where are the lights"):
        bpy.ops.mps.calibrate_mixing(grey=grey)
    write_rig(tmp_path / "rig.json", LightRig(LIGHTS))
    scene.mps.estimate.rig_file = str(tmp_path / "rig.json")
    with pytest.raises(RuntimeError, match="no photo of the grey ball is named"):
        bpy.ops.mps.calibrate_mixing(grey="")
    with pytest.raises(RuntimeError, match=r"name ends in \.json"):
        bpy.ops.mps.calibrate_lights(ball=mirror, output=str(tmp_path / "rig.txt"))
    with pytest.raises(RuntimeError, match="nowhere"):
        bpy.ops.mps.calibrate_lights(ball=str(tmp_path / "nowhere.exr"), output=str(tmp_path / "r.json"))
    assert not (tmp_path / "r.json").exists()
