"""Whatever the command line is given: it works, or it says in one sentence why not, and leaves nothing behind.

A few hundred cases drawn by Hypothesis, the same ones each time; MPSNET_FUZZ_MINUTES=10 draws others for so long.
"""

import argparse
import itertools
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from odd_input import WORDS, odd_picture, odd_pixels, spoilt
from workshop import READS, SIDE, SPHERE, VERBS

from mpsnet_core import InputError, read_cameras, read_height, read_sample
from mpsnet_core.cli import main
from mpsnet_core.cli.command import argument_parser
from mpsnet_core.synthesis.reflectance.measured import read_fits

pytestmark = pytest.mark.long

MINUTES = float(os.environ.get("MPSNET_FUZZ_MINUTES", "0"))
QUICK = 150
LONGEST_LINE = 600
# What the library reads and no verb does, or no quick one.
READERS: dict[str, Callable[[Path], Any]] = {
    "height.exr": read_height,
    "height.exr.json": lambda path: read_height(path.with_suffix("")),
    "sample.exr": read_sample,
    "fits.npz": read_fits,
    "cameras.xml": read_cameras,
    "cameras.sfm": read_cameras,
}
# A scheduler that is not there is waited for; --blender starts what it names.
NOT_TRIED = {"--cluster", "--blender", "--help", "--version"}


@dataclass(frozen=True)
class Spoilt:
    """What a file is to hold; where a case fails, the file stays in its folder."""

    name: str
    data: Any = field(repr=False)


@st.composite
def spoilt_files(draw: st.DrawFn, workshop: Path, names: Mapping[str, Any]) -> Spoilt:
    """One of the workshop's files, not quite as it is."""
    name = draw(st.sampled_from(sorted(names)))
    return Spoilt(name, draw(spoilt(workshop / name)))


class Bench:
    """Copies of the workshop, in which one case after the other is tried."""

    def __init__(self, workshop: Path, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
        self.workshop, self._folder, self._capfd = workshop, folder, capfd
        self._number = itertools.count()

    def copy(self) -> Path:
        here = self._folder / f"case{next(self._number)}"
        shutil.copytree(self.workshop, here, copy_function=os.link)  # nothing is written in place
        (here / "loop").symlink_to("loop")
        os.chdir(here)
        return here

    def leave(self, here: Path) -> None:
        os.chdir(self._folder)
        shutil.rmtree(here)

    def run(self, here: Path, arguments: list[str]) -> str:
        """Run the command line, whose result is what it may be; gives its sentence, "" where it works."""
        before = _listing(here)
        self._capfd.readouterr()
        try:
            code = main(arguments)
        except SystemExit as left:  # --help
            code = left.code
        out, err = self._capfd.readouterr()
        assert code in (0, 2), (code, err, _logs(self._folder))
        lines = err.splitlines()
        assert all(len(line) <= LONGEST_LINE and line.isprintable() for line in lines), err
        assert all(line.isprintable() for line in out.split("\n")), out
        if code:
            # A run that made some of several photos names each of the others, after its notes.
            sentences = [line for line in lines if "failed" not in out or not line.startswith("note: ")]
            assert all(line.startswith("mpsnet: ") for line in sentences) and "Traceback" not in err, err
            assert len(sentences) == 1 or (sentences and "failed" in out), err
            left = {name: size for name, size in _listing(here).items() if before.get(name) != size}
            # The picture that shows what was found, what a run over several photos made before, packed samples.
            told = {name for name in left if f"{name} shows the ball that" in err}
            assert all(name.startswith(("o/", "o.packed/")) for name in left.keys() - told), (left, err)
            assert before.keys() <= _listing(here).keys()
        else:
            assert all(line.startswith("note: ") for line in lines), err
        return err if code else ""


def _put(path: Path, data: bytes) -> None:
    path.unlink()
    path.write_bytes(data)


def _listing(folder: Path) -> dict[str, int]:
    return {str(path.relative_to(folder)): path.lstat().st_size for path in folder.rglob("*") if not path.is_dir()}


def _logs(folder: Path) -> str:
    return "\n".join(file.read_text() for file in folder.glob("mpsnet-*.log"))


@pytest.fixture
def bench(workshop: Path, tmp_path, capfd, monkeypatch) -> Iterator[Bench]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "warnoptions", ["error"])  # else the command line hides NumPy's warnings
    kept = Path.cwd()
    yield Bench(workshop, tmp_path, capfd)
    os.chdir(kept)


def hold(check: Callable[..., None], **drawn: st.SearchStrategy[Any]) -> None:
    """Try what is drawn: the same cases each time, or others for as long as is asked for."""
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    phases = [Phase.explicit, Phase.generate, Phase.shrink]
    asked = settings(
        max_examples=QUICK, derandomize=not MINUTES, deadline=None, suppress_health_check=checks, database=None,
        phases=phases, print_blob=False,
    )  # fmt: skip
    end = time.monotonic() + 60 * MINUTES / 4
    for _ in itertools.count():
        tried = asked(given(**drawn)(check))
        (seed(time.time_ns())(tried) if MINUTES else tried)()
        if time.monotonic() >= end:
            return


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_spoilt_files(bench: Bench) -> None:
    def check(case: Spoilt) -> None:
        here = bench.copy()
        _put(here / case.name, case.data)
        bench.run(here, READS[case.name].split())
        bench.leave(here)

    hold(check, case=spoilt_files(bench.workshop, READS))


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_odd_pixels(bench: Bench) -> None:
    pictures = sorted(name for name in READS if name.endswith(".exr") and name not in ("sample.exr", "height.exr"))

    @st.composite
    def cases(draw: st.DrawFn) -> Spoilt:
        name = draw(st.sampled_from(pictures))
        good = SPHERE.image if name == "photo.exr" else np.full((SIDE, SIDE, 3), 0.4, np.float32)
        return Spoilt(name, draw(odd_pixels(good)))

    def check(case: Spoilt) -> None:
        here = bench.copy()
        (here / case.name).unlink()
        odd_picture(here / case.name, *case.data)
        bench.run(here, READS[case.name].split())
        bench.leave(here)

    hold(check, case=cases())


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_odd_options(bench: Bench) -> None:
    lines = [line.split() for line in (*dict.fromkeys(READS.values()), *VERBS)]

    @st.composite
    def cases(draw: st.DrawFn) -> list[str]:
        line = list(draw(st.sampled_from(lines)))
        for _ in range(draw(st.integers(1, 2))):
            word = draw(st.sampled_from(WORDS))
            if draw(st.integers(0, 3)):
                line.append(f"{draw(st.sampled_from(_options(line)))}={word}")
            else:  # a positional argument, or a value that is there
                line[draw(st.sampled_from(_values(line)))] = word
        return line

    def check(line: list[str]) -> None:
        here = bench.copy()
        bench.run(here, line)
        bench.leave(here)

    hold(check, line=cases())


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_spoilt_files_of_the_library(bench: Bench) -> None:
    def check(case: Spoilt) -> None:
        here = bench.copy()
        _put(here / case.name, case.data)
        try:
            READERS[case.name](here / case.name)
        except InputError as error:
            assert str(error).isprintable() and len(str(error)) < LONGEST_LINE
        assert bench._capfd.readouterr() == ("", "")
        bench.leave(here)

    hold(check, case=spoilt_files(bench.workshop, READERS))


def _options(line: list[str]) -> list[str]:
    """The options of a command line's verb that take a value."""
    parser: argparse.ArgumentParser = argument_parser()
    for word in line:
        choices = next((a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)
        if not choices:
            break
        parser = choices[word]
    return [a.option_strings[-1] for a in parser._actions if a.option_strings and a.option_strings[-1] not in NOT_TRIED]


def _values(line: list[str]) -> list[int]:
    """Where the values and positional arguments of a command line stand."""
    words = 2 if line[0] in ("calibrate", "evaluate") else 1
    return [place for place in range(words, len(line)) if not line[place].startswith("-")] or [0]
