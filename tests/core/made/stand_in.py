"""A worker that stands in for a renderer: `python stand_in.py FOLDER` makes files that say when and by whom.

What it does with a number is told by files in the folder: ``die_N`` is what it dies of (once, the file goes first),
``always_die_N`` every time, ``die_late_N`` between writing and saying so, ``fail_N`` what it cannot make, ``slow``
how many seconds a sample waits, at most and while that file is there, ``template.exr`` what a sample looks like. Each
sample begun is a line of the file ``begun``: its number and the worker's process id.
"""

import os
import signal
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from mpsnet_core import InputError, write_image
from mpsnet_core.io.files import atomic_write
from mpsnet_core.synthesis.farm.work import THIS_PYTHON, serve
from mpsnet_core.synthesis.job import SampleJob, samples_there

# Windows knows no SIGKILL; its SIGTERM is as sudden.
KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
# What a whole sample of the stand-in ends with.
END = b"end"
COMMAND = (THIS_PYTHON, str(Path(__file__).resolve()))


def begun(folder: Path) -> dict[int, list[int]]:
    """Which workers (process ids) began each sample."""
    workers = defaultdict(list)
    if (folder / "begun").exists():
        for line in (folder / "begun").read_text().splitlines():
            number, pid = line.split()
            workers[int(number)].append(int(pid))
    return dict(workers)


def whole(folder: Path) -> set[int]:
    """Numbers of the samples there, each of which must be whole."""
    there = samples_there(folder)
    for number in there:
        assert (folder / f"sample_{number:06d}.exr").read_bytes().split()[-2:] == [str(number).encode(), END]
    return there


def make(job: SampleJob, number: int, path: Path) -> None:
    folder = path.parent
    with (folder / "begun").open("ab", buffering=0) as begun:
        begun.write(f"{number} {os.getpid()}\n".encode())
    if (folder / f"fail_{number}").exists():
        raise InputError(f"sample {number} shows nothing; choose another")
    slow = folder / "slow"
    seconds = float(slow.read_text()) if slow.exists() else 0.0
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(b"half of it ")
        for deadly in (folder / f"die_{number}", folder / f"always_die_{number}"):
            if deadly.exists():
                if deadly.name.startswith("die"):
                    deadly.unlink()
                os.kill(os.getpid(), KILL)
        end = time.monotonic() + seconds
        while slow.exists() and time.monotonic() < end:
            time.sleep(0.005)
        template = folder / "template.exr"
        if template.exists():
            unfinished.write_bytes(template.read_bytes())
        else:
            write_image(unfinished, np.zeros((1, 1, 1)), bits=16)
            with unfinished.open("ab") as file:
                file.write(f" {job.seed} {number} ".encode() + END)
    if (folder / f"die_late_{number}").exists():
        os.kill(os.getpid(), KILL)


if __name__ == "__main__":
    print("this is printed before it is ready")
    serve(sys.argv[-1], make)
