"""What a notebook gets: results that show themselves, paths for objects, and operations that explain themselves."""

import inspect
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import Sphere

import mpsnet_core
from mpsnet_core import Capture, HeightMap, InputError, NormalMap, Texture, View, normal_errors, read_image
from mpsnet_core.io.from_files import _own_kinds
from mpsnet_core.io.shown import LONGEST, Shown
from mpsnet_core.progress import remaining_words
from mpsnet_core.scene.camera import pixel_camera, write_camera
from mpsnet_core.scene.normal_map import write_normals


@pytest.fixture
def results(sphere: Sphere) -> list[Shown]:
    height, width = sphere.mask.shape
    normals = NormalMap(sphere.normals, sphere.mask)
    return [
        normals,
        HeightMap(np.where(sphere.mask, sphere.normals[..., 2], 0), sphere.mask, pixel_camera(width, height)),
        Capture(sphere.image, sphere.mask, sphere.rig),
        Texture(normals.vectors, sphere.mask, sphere.mask, "tangent"),
        normal_errors(normals, normals),
    ]


def test_results_show_a_line_a_picture_and_their_array(results: list[Shown], tmp_path: Path) -> None:
    for result in results:
        assert len(repr(result)) < 120 and "\n" not in repr(result)
        file = tmp_path / "picture.png"
        file.write_bytes(result._repr_png_())
        height, width = result.shape[:2]
        shown = read_image(file).pixels.shape
        assert shown[0] <= LONGEST and abs(shown[0] - height / -(-max(height, width) // LONGEST)) < 1
        assert np.asarray(result) is getattr(result, result.array_name) and np.asarray(result).shape == result.shape
        copied = np.array(result, np.float64)
        assert copied.dtype == np.float64 and not np.shares_memory(copied, np.asarray(result))


def test_a_large_picture_is_thinned_out() -> None:
    mask = np.ones((2 * LONGEST + 1, 8), bool)
    assert NormalMap(np.ones((*mask.shape, 3), np.float32), mask).picture(3).shape == (427, 3, 3)


TAKERS = [
    name
    for name in mpsnet_core.__all__
    if inspect.isfunction(getattr(mpsnet_core, name)) or name in {"Capture", "HeightMap", "View"}
    if any(_own_kinds(one.annotation)[0] for one in inspect.signature(getattr(mpsnet_core, name)).parameters.values())
]


@pytest.mark.parametrize("name", TAKERS)
def test_what_is_no_object_is_refused_in_a_sentence(name: str) -> None:
    taker = getattr(mpsnet_core, name)
    parameters = inspect.signature(taker).parameters.values()
    with pytest.raises(InputError, match="cannot be used; give a"):
        list(taker(**{one.name: object() for one in parameters if one.default is one.empty}))


def test_paths_are_taken_where_objects_are(sphere: Sphere, rig_file: Path, photo_file: Path, tmp_path: Path) -> None:
    height, width = sphere.mask.shape
    write_camera(tmp_path / "camera.json", pixel_camera(width, height))
    write_normals(tmp_path / "normals.exr", NormalMap(sphere.normals, sphere.mask))
    by_path = mpsnet_core.read_capture(photo_file, rig_file, camera=tmp_path / "camera.json")  # type: ignore[arg-type]
    by_rig = mpsnet_core.read_capture(str(photo_file), sphere.rig, camera=50)
    assert np.allclose(by_path.rig.directions, by_rig.rig.directions) and by_path.camera is not None
    view: Any = View(tmp_path / "camera.json", str(tmp_path / "normals.exr"))  # type: ignore[arg-type]
    assert np.allclose(view.normals.vectors, sphere.normals * sphere.mask[..., None], atol=1e-3)
    assert normal_errors(view.normals, tmp_path / "normals.exr").mean == 0  # type: ignore[arg-type]


def test_run_shows_a_bar_only_where_somebody_watches(photo_file, rig_file, capfd, monkeypatch) -> None:
    estimate = mpsnet_core.Estimate(
        image=(str(photo_file),), rig=str(rig_file), model="lambertian", output=str(photo_file.with_suffix(".png"))
    )
    assert estimate.run().text and capfd.readouterr().err == ""
    estimate.run(progress=True)  # type: ignore[arg-type]
    assert "%" in capfd.readouterr().err

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    estimate.run()
    assert "%" in terminal.getvalue() and "so far" in terminal.getvalue()


def test_the_remaining_time_is_told_once_and_in_units() -> None:
    assert remaining_words(0.25, 60) == "1 min 0 s so far, about 3 min 0 s left"
    assert remaining_words(0.5, 8) == "8 s so far, about 8 s left"
    assert "left" not in remaining_words(0.001, 8) + remaining_words(0.5, 1) + remaining_words(1, 9)
