"""`mpsnet example`: what it says to type runs as it stands, and its truth fits its mesh."""

import contextlib
import io
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from mpsnet_core import angular_error, read_camera, read_mesh, read_normals, read_rig
from mpsnet_core.cli import main
from mpsnet_core.synthesis.example import LIGHTS


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder where it ran, and the lines that it printed."""
    folder = tmp_path_factory.mktemp("made")
    with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as told:
        assert main(["example"]) == 0
    return folder, told.getvalue().splitlines()


@pytest.fixture
def example(made: tuple[Path, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The lines that it prints, in a folder where it ran."""
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return made[1]


def test_each_printed_command_runs_and_gives_the_truth(example: list[str], mpsnet, monkeypatch) -> None:
    monkeypatch.chdir("example")
    assert sum(file.stat().st_size for file in Path().iterdir()) < 3_000_000
    for line in example:
        if line.startswith("mpsnet "):
            quicker = {"bake": ("--size", "256"), "estimate": ("--passes", "1")}.get(line.split()[1], ())
            done = mpsnet(*shlex.split(line)[1:], *quicker)
            assert done.returncode == 0, done.stderr
    assert sum(line.startswith("mpsnet ") for line in example) == 5
    truth = read_normals("truth.png")
    for name, most in (("normals.png", 8.0), ("better.png", 3.5)):
        found = read_normals(name)
        assert angular_error(found.vectors, truth.vectors)[found.mask & truth.mask].mean() < most
    assert (angular_error(read_rig("rig.json").directions, LIGHTS) < 0.5).all()
    assert Path("relit.png").is_file() and Path("egg_normal.png").is_file()


@pytest.mark.usefixtures("example")
def test_the_scan_lies_where_the_true_normals_show_it() -> None:
    """By the projection of its vertices: those that face the camera land on pixels of about their normals."""
    mesh, camera, truth = (
        read_mesh("example/egg.obj"),
        read_camera("example/camera.json"),
        read_normals("example/truth.png"),
    )
    points, normals = mesh.world_vertices[mesh.triangles[:, 0]], mesh.corner_normals[:, 0]
    x, y, w = camera.projection_rows() @ np.c_[points, np.ones(len(points))].T
    front = normals[:, 2] > 0.5
    column, row = (np.floor(along / w).astype(int)[front] for along in (x, y))
    assert truth.mask[row, column].all()
    assert angular_error(truth.vectors[row, column], normals[front]).mean() < 10  # the scan lacks the carving


@pytest.mark.usefixtures("example")
def test_an_example_that_is_there_stays_and_a_stranger_s_file_is_not_replaced(mpsnet, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("mpsnet_core.synthesis.example.SIZE", 64)
    scan = tmp_path / "example" / "egg.obj"
    scan.write_text("mine", encoding="utf-8")
    assert mpsnet("example").returncode == 0 and scan.read_text(encoding="utf-8") == "mine"
    (tmp_path / "example" / "ball.png").unlink()
    assert mpsnet("example").returncode == 2 and scan.read_text(encoding="utf-8") == "mine"
    assert mpsnet("example", "--overwrite").returncode == 0 and len(read_mesh(scan).triangles) > 1000
