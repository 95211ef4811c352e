"""Normals against true ones: the figures are the angles that were put in."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from surface_shapes import camera_looking

from mpsnet_core import NormalMap, write_camera, write_normals
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import read_data

SIZE = 40


def tilted(degrees: np.ndarray) -> np.ndarray:
    """(..., 3) normals that lean to the right by so much."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)


def angles() -> np.ndarray:
    """(S, S) degrees: 30 in a quarter of the rows, 4 in the others."""
    return np.repeat(np.where(np.arange(SIZE) < SIZE // 4, 30.0, 4.0)[:, None], SIZE, axis=1)


def compare(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict, str]:
    code = main(["compare", *map(str, arguments), "--progress", "json"])
    out, err = capsys.readouterr()
    return code, json.loads(out.splitlines()[-1]).get("result", {}), err


def test_mean_and_median_are_those_of_the_angles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left = np.arange(SIZE) < SIZE // 2
    write_normals(tmp_path / "n.exr", NormalMap(tilted(angles()), np.ones((SIZE, SIZE), bool)))
    write_normals(tmp_path / "t.exr", NormalMap(tilted(np.zeros((SIZE, SIZE))), np.broadcast_to(left, (SIZE, SIZE))))
    code, found, _ = compare(capsys, tmp_path / "n.exr", "--truth", tmp_path / "t.exr", "-o", tmp_path / "e.png")
    assert code == 0 and found["share"] == 0.5
    assert (found["mean"], found["median"]) == pytest.approx((0.25 * 30 + 0.75 * 4, 4), abs=0.01)
    picture, _ = read_data(tmp_path / "e.png")
    assert picture.shape[0] == SIZE and picture.shape[1] > SIZE  # the scale stands beside it
    bright = picture[:, :SIZE].sum(axis=-1)
    assert bright[: SIZE // 4, : SIZE // 2].min() > bright[SIZE // 4 :, : SIZE // 2].max()
    assert np.ptp(bright[:, SIZE // 2 :]) == 0  # the background


def test_each_map_has_its_convention(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    normals = NormalMap(tilted(angles())[..., [1, 0, 2]], np.ones((SIZE, SIZE), bool))  # they lean up
    for convention in ("opengl", "directx"):
        write_normals(tmp_path / f"{convention}.exr", normals, convention=convention)
    gl, dx = tmp_path / "opengl.exr", tmp_path / "directx.exr"
    for arguments, mean in (
        ((dx, "--convention", "directx", "--truth", gl), 0),
        ((gl, "--truth", dx, "--truth-convention", "directx"), 0),
        ((gl, "--truth", dx), 21),
    ):
        assert compare(capsys, *arguments)[1]["mean"] == pytest.approx(mean, abs=0.01)
    write_camera(tmp_path / "c.json", camera_looking((0.5, -1, 0.7), size=SIZE))
    code, _, sentence = compare(
        capsys, gl, "--truth", dx, "--truth-convention", "directx", "--camera", tmp_path / "c.json"
    )
    assert code == 2 and "is a render's passes, without a convention" in sentence


def test_with_a_camera_the_true_normals_are_the_worlds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    camera = camera_looking((0.5, -1, 0.7), size=SIZE)
    write_camera(tmp_path / "c.json", camera)
    write_normals(tmp_path / "n.exr", NormalMap(tilted(angles()), np.ones((SIZE, SIZE), bool)))
    spec = oiio.ImageSpec(SIZE, SIZE, 7, oiio.FLOAT)
    layers = [f"ViewLayer.Combined.{channel}" for channel in "RGBA"] + [f"ViewLayer.Normal.{axis}" for axis in "XYZ"]
    spec.channelnames = tuple(layers)
    world = np.tile(camera.rotation[:, 2], (SIZE, SIZE, 1))  # all face the camera
    world[:, -1] = np.nan
    alpha = np.ones((SIZE, SIZE, 4))
    alpha[:, : SIZE // 2] = 0.5
    file = oiio.ImageOutput.create(str(tmp_path / "t.exr"))
    file.open(str(tmp_path / "t.exr"), spec)
    file.write_image(np.concatenate([alpha, world], axis=-1).astype(np.float32))
    file.close()
    _, found, _ = compare(capsys, tmp_path / "n.exr", "--truth", tmp_path / "t.exr", "--camera", tmp_path / "c.json")
    assert (found["mean"], found["median"], found["share"]) == pytest.approx((10.5, 4, 0.475), abs=0.01)
    assert "output" not in found
    code, _, sentence = compare(capsys, tmp_path / "n.exr", "--truth", tmp_path / "t.exr")
    assert code == 2 and "t.exr is a render whose pass Normal is in the world's axes; give" in sentence


def test_normals_of_another_view_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, size, where in (("a", SIZE, 0), ("b", SIZE, 1), ("c", 16, 0)):
        mask = np.zeros((size, size), bool)
        mask[where::2] = True
        write_normals(tmp_path / f"{name}.png", NormalMap(tilted(np.zeros((size, size))), mask))
    for other, said in (("b", "no pixel has both"), ("c", "are 40 x 40 but the true ones 16 x 16"), ("d", "exist")):
        code, _, sentence = compare(capsys, tmp_path / "a.png", "--truth", tmp_path / f"{other}.png")
        assert code == 2 and said in sentence and len(sentence.splitlines()) == 1
