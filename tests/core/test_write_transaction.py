"""What a verb writes belongs together: all of it is new, or all of it is as it was, whatever stops the writing."""

import contextlib
import errno
import io
import itertools
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bake_bench import Bench
from ball_scene import CIRCLE, SCENE
from height_shapes import ball, orthographic
from mirror_ball import photograph
from synthetic import listing, shaded_sphere

from mpsnet_core import write_image, write_normals, write_rig
from mpsnet_core.cli import main

pytestmark = pytest.mark.long

# Each verb's command, and the options of an earlier and of a later run.
VERBS = {
    "heights": (
        "integrate {0}/ball.png --height h.png --curvature c.png --occlusion o.tif --relit r.png",
        ("--pixel-size 1", "--pixel-size 2 --light 30,90"),
    ),
    "bake": (
        "bake --mesh {0}/mesh.npz --view {0}/camera.json={0}/n.png --albedo {0}/a.png -o t.<UDIM>.png --space object",
        ("--size 32", "--size 64"),
    ),
    "calibrate": (
        "calibrate lights {0}/mirror.exr -o rig.json --overlay seen.png --json told.json",
        (f"--circle {CIRCLE}", "--circle 130.5,105,70"),
    ),
    "estimate": (
        "estimate {0}/photo.exr --rig {0}/rig.json --model lambertian -o n.png --confidence sure.exr",
        ("--mask threshold:0.05", "--mask threshold:0.4"),
    ),
}
KILLS = int(os.environ.get("MPSNET_KILLS", "2"))


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a folder, without the times of writing that TIFF and EXR hold."""
    when = re.compile(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d")
    return {name: when.sub(b"then", (folder / name).read_bytes()) for name in listing(folder)}


class Verb:
    """A verb with inputs of its own, and the files that an earlier run makes and a later one makes of them."""

    def __init__(self, name: str, inputs: Path) -> None:
        self.name, self.inputs = name, inputs
        made = inputs / name
        states, self.files = [], dict[str, bytes]()
        for turn in (0, 1):
            made.mkdir(exist_ok=True)
            code, said = self.run(turn, made)
            assert code == 0, said
            states.append(contents(made))
            self.files = self.files or {one: (made / one).read_bytes() for one in listing(made)}
        self.before, self.after = states
        assert self.before.keys() == self.after.keys() and len(self.after) > 1
        shutil.rmtree(made)

    def command(self, turn: int) -> list[str]:
        words, options = VERBS[self.name]
        return f"{words} {options[turn]}".format(self.inputs).split()

    def run(self, turn: int, folder: Path) -> tuple[int, str]:
        """The exit code, and what is said on stderr."""
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()) as said,
        ):
            code = main(self.command(turn))
        return code, said.getvalue()

    def put(self, folder: Path) -> None:
        """Have the earlier run's files in a folder, and nothing else."""
        for name in listing(folder):
            (folder / name).unlink()
        for name, data in self.files.items():
            (folder / name).write_bytes(data)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the verbs read."""
    folder = tmp_path_factory.mktemp("inputs")
    Bench(folder)  # mesh.npz, camera.json, n.png
    write_image(folder / "a.png", np.full((16, 96, 3), 0.5))
    sphere = shaded_sphere()
    write_rig(folder / "rig.json", sphere.rig)
    write_image(folder / "photo.exr", sphere.image)
    write_image(folder / "mirror.exr", photograph(SCENE))
    write_normals(folder / "ball.png", ball(orthographic(64, 72, 16), (0, 0, 0), 1.7).normals)
    return folder


@pytest.fixture(scope="module", params=VERBS)
def verb(request: pytest.FixtureRequest, inputs: Path) -> Verb:
    return Verb(request.param, inputs)


class Failing:
    """In place of a function of the system's: after so many calls one fails as on a full disk, or all without it."""

    def __init__(self, real: Any, calls: int) -> None:
        self.real, self.left = real, calls

    def __call__(self, *given: Any) -> Any:
        self.left -= 1
        if self.left == -1 or self.real is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.real(*given)


@pytest.mark.parametrize(("step", "links"), [("fsync", True), ("replace", True), ("replace", False)])
def test_whichever_step_fails_all_is_as_it_was(verb: Verb, tmp_path, monkeypatch, step: str, links: bool) -> None:
    """Each file's writing to the disk, or its renaming, in turn; also on a disk that knows no second names."""
    if not links:
        monkeypatch.setattr(os, "link", Failing(None, 0))
    real, failed = getattr(os, step), 0
    for number in itertools.count():
        verb.put(tmp_path)
        with monkeypatch.context() as patch:
            patch.setattr(os, step, failing := Failing(real, number))
            code, said = verb.run(1, tmp_path)
        assert contents(tmp_path) == (verb.before if code else verb.after), (number, said)
        failed += code == 2 and "cannot write" in said
        if failing.left >= 0:  # there are no more calls
            break
    assert code == 0 and failed == len(verb.after)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_killed_at_any_moment_it_leaves_all_as_it_was_or_all_new(verb: Verb, tmp_path: Path) -> None:
    """SIGKILL while it writes; only between two of its renamings, which have second names beside them, there are both.

    MPSNET_KILLS says how often.
    """
    moments, seconds = random.Random(5), 0.0
    command = [sys.executable, "-m", "mpsnet_core", *verb.command(1)]

    def begun() -> list[str]:
        return [name for name in listing(tmp_path) if "unfinished" in name]

    for kill in range(-1, KILLS):
        verb.put(tmp_path)
        child = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
        while not begun():
            assert child.poll() is None
            time.sleep(0.0002)
        start = time.monotonic()
        if kill < 0:  # how long it writes
            assert child.wait(60) == 0
            seconds = time.monotonic() - start
            continue
        time.sleep(moments.random() * seconds)
        child.send_signal(signal.SIGKILL)
        child.wait(60)
        found = contents(tmp_path)
        kept = [found.pop(name) for name in begun()]
        assert found.keys() == verb.before.keys()
        assert all(data in (verb.before[name], verb.after[name]) for name, data in found.items())
        if not any(data in verb.before.values() for data in kept):
            assert found in (verb.before, verb.after)
    assert subprocess.run(command, cwd=tmp_path, stdout=subprocess.DEVNULL, timeout=60).returncode == 0
    assert contents(tmp_path) == verb.after
