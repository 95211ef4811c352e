"""Cameras: where points fall in the image, rays back into the world, and camera files."""

from pathlib import Path

import numpy as np
import pytest
from bad_input import gets_one_clear_sentence

from mpsnet_core.scene.camera import Camera, read_camera, write_camera

# Looks along world -x from (5, 2, 1): camera x is world y, camera y is world z, camera z is world x.
SIDEWAYS = np.array([[0, 0, 1, 5], [1, 0, 0, 2], [0, 1, 0, 1], [0, 0, 0, 1.0]])


def project(camera: Camera, point: list[float]) -> np.ndarray:
    x, y, w = camera.projection_rows() @ [*point, 1]
    return np.array([x, y]) / w


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_the_optical_axis_meets_the_image_in_its_middle(projection: str) -> None:
    camera = Camera(projection, 640, 480, (100, 100), None, SIDEWAYS)
    assert project(camera, [-3, 2, 1]) == pytest.approx([320, 240])


def test_orthographic_pixels_do_not_depend_on_depth_and_rows_count_down() -> None:
    camera = Camera("orthographic", 64, 32, (10, 20), (30, 16), SIDEWAYS)
    for depth in (0, -40):
        assert project(camera, [depth, 2 + 1.5, 1 + 0.25]) == pytest.approx([30 + 15, 16 - 5])


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_rays_go_through_the_pixels_they_were_asked_for(projection: str) -> None:
    camera = Camera(projection, 64, 48, (80, 90), (31, 20), SIDEWAYS)
    pixels = np.array([[0, 0], [64, 0], [12.5, 47.25]])
    origins, directions = camera.rays(pixels)
    assert np.linalg.norm(directions, axis=1) == pytest.approx([1, 1, 1])
    for pixel, origin, direction in zip(pixels, origins, directions, strict=True):
        point = origin + 3.7 * direction
        assert project(camera, list(point)) == pytest.approx(pixel)
        assert camera.depth_row() @ [*point, 1] > 0


def test_depth_is_measured_along_the_axis() -> None:
    camera = Camera("perspective", 64, 48, (80, 90), None, SIDEWAYS)
    assert camera.depth_row() @ [1, 7, 9, 1] == pytest.approx(4)
    assert camera.depth_row() @ [6, 0, 0, 1] == pytest.approx(-1)


def test_a_camera_file_gives_the_camera_back(tmp_path: Path) -> None:
    camera = Camera("perspective", 64, 48, (80.5, 90.25), (31, 20), SIDEWAYS)
    write_camera(tmp_path / "camera.json", camera)
    back = read_camera(tmp_path / "camera.json")
    assert (back.projection, back.width, back.height) == ("perspective", 64, 48)
    np.testing.assert_array_equal(back.focal, camera.focal)
    np.testing.assert_array_equal(back.centre, camera.centre)
    np.testing.assert_array_equal(back.world_from_camera, camera.world_from_camera)


test_a_bad_camera_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: read_camera(b.camera(projection="fisheye")), '"orthographic" or "perspective", not \'fisheye\''),
        ("half a pixel", lambda b: read_camera(b.camera(height=1.5)), "camera.json…height must be a whole number"),
        ("focal 0", lambda b: read_camera(b.camera(focal=[8, 0])), "camera.json…focal in x and in y must be"),
        (lambda b: read_camera(b.camera(world_from_camera=np.diag([2, 2, 2, 1]).tolist())), "not a rotation and a"),
        ("pose mirrored", lambda b: Camera("orthographic", 4, 4, (1, 1), None, np.diag([-1, 1, 1, 1])), "mirroring"),
        (lambda b: read_camera(b.camera(world_from_camera=[[10**400] * 4] * 4)), "world_from_camera must be 4 by 4"),
    ]
)
