"""Fixtures of the core's tests."""

import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

# Before NumPy and PyTorch are imported, and for the processes that tests start: matrices here are small, and threads
# that wait for each other cost up to ten times what they save.
for library in ("OPENBLAS", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
# And these processes compile the package once, not each anew, which is half of a short one's time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from external_data import external_data
from synthetic import Sphere, shaded_sphere, write_file

from mpsnet_core.cli import main
from mpsnet_core.scene.rig import write_rig

Mpsnet = Callable[..., "subprocess.CompletedProcess[str]"]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files of long tests alone are not even imported where none of these runs: what they import takes seconds."""
    if config.option.markexpr == "not long" and collection_path.suffix == ".py":
        return "\npytestmark = pytest.mark.long\n" in collection_path.read_text(encoding="utf-8") or None
    return None


@pytest.fixture(scope="session")
def diligent() -> Path:
    """DiLiGenT's pmsData folder."""
    return external_data("diligent/pmsData")


@pytest.fixture(scope="session")
def captures() -> Path:
    """The folder with photographs of things under white lights."""
    return external_data("captures")


@pytest.fixture(scope="session")
def sphere() -> Sphere:
    return shaded_sphere()


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a good file of every kind."""
    from workshop import fill

    here = tmp_path_factory.mktemp("workshop")
    fill(here)
    return here


@pytest.fixture
def rig_file(tmp_path: Path, sphere: Sphere) -> Path:
    path = tmp_path / "rig.json"
    write_rig(path, sphere.rig)
    return path


@pytest.fixture
def photo_file(tmp_path: Path, sphere: Sphere) -> Path:
    """The sphere as a float EXR without alpha."""
    return write_file(tmp_path / "photo.exr", sphere.image, "float")


@pytest.fixture
def mpsnet_process() -> Mpsnet:
    """Runs the command line in a process of its own, to the end."""

    def run(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "mpsnet_core", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    return run


@pytest.fixture
def process_settings_restored(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """`main` sets the process up for itself alone; put back what it set. Warnings are errors here, not hidden by it."""
    monkeypatch.setattr(sys, "warnoptions", ["error"])
    log = logging.getLogger("mpsnet_core")
    propagate, level = log.propagate, log.level
    yield
    log.propagate = propagate
    log.setLevel(level)


@pytest.fixture
def mpsnet(capfd: pytest.CaptureFixture[str], process_settings_restored: None) -> Mpsnet:
    """Runs the command line in this process, most of a second sooner."""

    def run(*arguments: str | Path) -> "subprocess.CompletedProcess[str]":
        capfd.readouterr()
        code = main([str(argument) for argument in arguments])
        return subprocess.CompletedProcess(arguments, code, *capfd.readouterr())

    return run
