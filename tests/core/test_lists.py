"""Nested lists are as good as arrays, for every function and dataclass of the package that takes arrays."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpsnet_core import (
    Camera,
    Capture,
    View,
    bake_normals,
    blend_detail,
    curvature,
    curvature_picture,
    curvature_range,
    displacement,
    estimate_normals,
    published_rig,
    read_image,
    relit,
    undistorted,
    write_albedo,
    write_image,
)
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.photogrammetry import Lens

SIZE = 6
RANDOM = np.random.default_rng(0)
COLOURS = RANDOM.uniform(0.2, 0.8, (SIZE, SIZE, 3)).astype(np.float32)
GREY = COLOURS[..., 0]
MASK = np.ones((SIZE, SIZE), bool)
UPWARDS = np.tile(np.float32([0, 0, 1]), (SIZE, SIZE, 1)) + 0.3 * COLOURS
NORMALS = NormalMap(UPWARDS, MASK)
POSE = np.eye(4)
POSE[:3, 3] = (0.5, 0.5, 3)
CAMERA = Camera("perspective", SIZE, SIZE, np.array([15.0, 15.0]), None, POSE)
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
MESH = Mesh(SQUARE, TRIANGLES, np.tile([0.0, 0, 1], (2, 3, 1)), SQUARE[TRIANGLES][..., :2])
Given = Callable[[np.ndarray], Any]


def baked(**options: Any) -> Any:
    return bake_normals(MESH, [View(CAMERA, NORMALS, **options)], size=64)


def capture(given: Given) -> np.ndarray:
    clipped = given(COLOURS > 0.7)
    shown = Capture(
        given(COLOURS), given(MASK), published_rig(30, 90), clipped=clipped, white=given(COLOURS), white_clipped=clipped
    )
    return estimate_normals(shown, "lambertian").vectors


def written(path: Path, write: Callable[[Path], None]) -> np.ndarray:
    write(path)
    return read_image(path).pixels


CASES: dict[str, Callable[[Given, Path], Any]] = {
    "Capture": lambda given, _: capture(given),
    "NormalMap": lambda given, _: NormalMap(given(UPWARDS), given(MASK), given(GREY)).vectors,
    "View": lambda given, _: baked(colours=given(COLOURS)).colours,
    "blend_detail": lambda given, _: blend_detail(baked(), given(np.tile(UPWARDS[:1, :1], (64, 64, 1)))).vectors,
    "curvature": lambda given, _: curvature(NORMALS, CAMERA, given(1 + GREY)),
    "curvature_picture": lambda given, _: curvature_picture(given(GREY), 1.0),
    "curvature_range": lambda given, _: curvature_range(given(GREY), given(MASK)),
    "displacement": lambda given, _: displacement(given(np.tile(UPWARDS[:1, :1], (64, 64, 1))), MESH).values,
    "relit": lambda given, _: relit(NORMALS, [0, 0, 1], occlusion=given(GREY), albedo=given(COLOURS)),
    "undistorted": lambda given, _: undistorted(given(COLOURS), CAMERA, Lens(radial=(-0.1,))),
    "write_albedo": lambda given, path: written(path, lambda file: write_albedo(file, given(COLOURS), given(MASK))),
    "write_image": lambda given, path: written(path, lambda file: write_image(file, given(COLOURS))),
}


@pytest.mark.parametrize("name", CASES)
def test_lists_are_taken_as_arrays(name: str, tmp_path: Path) -> None:
    of_lists, of_arrays = (CASES[name](given, tmp_path / "a.exr") for given in (np.ndarray.tolist, np.asarray))
    np.testing.assert_allclose(of_lists, of_arrays, rtol=1e-6)
