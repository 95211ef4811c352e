"""A real Blender with the extension's zip installed in a user folder of its own.

MPSNET_BLENDER         the command of a Blender; without it every test here is skipped
MPSNET_EXTENSION_ZIP   the zip to install; built for that Blender's Python where it is not given
MPSNET_BLENDER_UI      the command that opens that Blender with a window; without it the window is not tested
MPSNET_SCREENSHOTS     the folder to leave pictures of the window in, those of the guided tour among them
MPSNET_SCREEN          what goes before `xdotool` and `import` to reach that window's screen, "env DISPLAY=:1" or so
"""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from live import Window, save

HERE = Path(__file__).parent
PROJECT = HERE.parent.parent
SCRIPTS = HERE / "scripts"
TIMEOUT = 300


@dataclass(frozen=True)
class Blender:
    """A Blender's command and the user folder it runs with."""

    command: Sequence[str]
    user: Path

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "BLENDER_USER_RESOURCES": str(self.user)}

    def run(self, *arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run to the end, whatever the exit code."""
        return subprocess.run(
            [*self.command, *map(str, arguments)],
            env={**self.environment, **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            cwd=PROJECT,
        )

    def script(self, name: str, report: Path, *arguments: str | Path) -> Any:
        """Run tests/blender/scripts/NAME with `-b`; it gets `report`, a JSON file to write, and `arguments`."""
        # The script's own exit code 3 tells an exception in it from Blender's other failures.
        done = self.run("-b", "--python-exit-code", "3", "--python", SCRIPTS / name, "--", report, *arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(report.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def extension_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if "MPSNET_BLENDER" not in os.environ:
        pytest.skip("MPSNET_BLENDER is not set")
    if given := os.environ.get("MPSNET_EXTENSION_ZIP"):
        return Path(given).resolve()
    folder = tmp_path_factory.mktemp("zip")
    ask = "import sys; print('python %d.%d' % sys.version_info[:2])"
    blender = Blender(shlex.split(os.environ["MPSNET_BLENDER"]), tmp_path_factory.mktemp("user"))
    answer = blender.run("-b", "--python-expr", ask).stdout
    (python,) = (line.split()[1] for line in answer.splitlines() if line.startswith("python "))
    command = [PROJECT / ".ci/build_extension.py", f"--python={python}", "--platform=linux-x64"]
    subprocess.run([sys.executable, *command, f"--output={folder}"], check=True)
    (built,) = folder.glob("*.zip")
    return built


@pytest.fixture(scope="session")
def blender(extension_zip: Path, tmp_path_factory: pytest.TempPathFactory) -> Blender:
    """Blender with the extension installed and enabled."""
    blender = Blender(shlex.split(os.environ["MPSNET_BLENDER"]), tmp_path_factory.mktemp("user"))
    done = blender.run("--command", "extension", "install-file", "-r", "user_default", "-e", extension_zip)
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    return blender


@contextmanager
def opened(blender: Blender, folder: Path, *arguments: str) -> Iterator[Window]:
    """A window that goes when the context ends; its last look is left in `folder`. arguments: of scripts/window.py."""
    if "MPSNET_BLENDER_UI" not in os.environ:
        pytest.skip("MPSNET_BLENDER_UI is not set")
    state, request = folder / "state.json", folder / "request"
    script = ["--python", SCRIPTS / "window.py", "--", state, request, *arguments]
    command = [*shlex.split(os.environ["MPSNET_BLENDER_UI"]), *script]
    with (folder / "window.log").open("w") as log:
        process = subprocess.Popen(
            command, env=blender.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
        window = Window(state, request, shlex.split(os.environ.get("MPSNET_SCREEN", "")))
        try:
            window.wait(lambda state: state["sidebar"], "sidebar")
            yield window
            save(folder / "last.png", window.screenshot())
        finally:
            window.ask("quit")
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGTERM)


@pytest.fixture
def window(blender: Blender, tmp_path: Path) -> Iterator[Window]:
    """A window whose panels are as they come."""
    with opened(blender, tmp_path) as window:
        yield window


@pytest.fixture
def unfolded(blender: Blender, tmp_path: Path) -> Iterator[Window]:
    """A window whose panels are all unfolded."""
    with opened(blender, tmp_path, "unfolded") as window:
        yield window


@pytest.fixture
def album(tmp_path: Path) -> Path:
    """Where pictures go that people look at."""
    folder = Path(os.environ.get("MPSNET_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
