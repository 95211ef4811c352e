"""Runs of the farm as processes of their own, with a worker that stands in for a renderer."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import stand_in
from stand_in import begun

from mpsnet_core.synthesis.job import SampleJob

RUN = """
import sys
from mpsnet_core.io.child_process import LAST_WORDS, LONGEST_WORDS
from mpsnet_core.synthesis.farm.run import make_samples
from mpsnet_core.synthesis.job import SampleJob
from stand_in import COMMAND

outcome = make_samples(sys.argv[1], SampleJob("synthesis", int(sys.argv[2]), seed=5), COMMAND, processes=2)
print(outcome.made, outcome.there, len(outcome.failed))
"""

posix = pytest.mark.skipif(sys.platform == "win32", reason="POSIX processes")


def job(count: int, **changes: object) -> SampleJob:
    return SampleJob("synthesis", count, seed=5, **changes)  # type: ignore[arg-type]


def start(folder: Path, count: int) -> "subprocess.Popen[str]":
    """A run of its own process, with two workers."""
    environment = {**os.environ, "PYTHONPATH": str(Path(stand_in.__file__).parent)}
    command = [sys.executable, "-c", RUN, str(folder), str(count)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not fetched by its parent does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat")
    try:
        return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition: Callable[[], object], seconds: float = 60) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come about"
        time.sleep(0.01)


def workers(folder: Path) -> set[int]:
    return {pid for pids in begun(folder).values() for pid in pids}
