"""What `pip install` leaves: the wheel, built and run as another machine has it."""

import os
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from documentation import PROJECT

import mpsnet_core
from mpsnet_core.estimate.registry import known_models


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to import mpsnet_core from."""
    if find_spec("hatchling") is None:
        pytest.skip("needs hatchling (the extra dev)")
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=PROJECT, check=True, capture_output=True, timeout=120)
    (wheel,) = folder.glob("*.whl")
    assert wheel.stat().st_size <= 16_000_000
    zipfile.ZipFile(wheel).extractall(folder / "here")
    return folder / "here"


def run(installed: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "mpsnet_core", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run(command, cwd=installed, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.long
def test_a_network_to_compare_with_says_where_to_get_it(installed: Path) -> None:
    listed = run(installed, "models").stdout
    for model in (one for one in known_models() if one.sha256):
        place = installed / "mpsnet_core" / "estimate" / "models" / "comparison"
        told = f"not installed: put {model.name}.onnx (sha256 {model.sha256}) from the repository's"
        assert told in listed
        done = run(installed, "models", model.name)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith(f"mpsnet: the network {model.name}, to compare with, is {told}")
        assert str(place) in done.stderr and f"mpsnet train --recipe {model.name}" in done.stderr


@pytest.mark.long
def test_the_wheel_runs_the_default(installed: Path) -> None:
    assert run(installed, "models", "multiscale").returncode == 0


def test_every_file_has_the_same_version() -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "version" in project["dynamic"], "pyproject takes it from mpsnet_core/__init__.py"
    version = mpsnet_core.__version__
    manifest = tomllib.loads((PROJECT / "blender_addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == version
    assert f"\nversion: {version}\n" in (PROJECT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (PROJECT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## [")
    assert changes[1].startswith((f"{version}]", "Unreleased]"))
