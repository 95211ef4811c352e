"""Rules that hold for every verb: what it opens, what it overwrites, what it leaves.

Each test walks over the command lines of :mod:`workshop`.
"""

import os
import shutil
import signal
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from workshop import READS, VERBS, fill

from mpsnet_core.cli import main

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform == "win32", reason="pipes and links of POSIX")]

LINES = list(dict.fromkeys([*READS.values(), *VERBS]))
MINE = b"mine"


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    here = tmp_path_factory.mktemp("workshop")
    fill(here)
    return here


class Place:
    """A copy of the workshop in which a command line runs."""

    def __init__(self, workshop: Path, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(workshop, folder, copy_function=os.link, symlinks=True)  # nothing is written in place
        self.before = self.files()

    def files(self) -> dict[str, tuple[int, int]]:
        """Each file and folder, with what changes if it is replaced."""
        facts = {str(path.relative_to(self.folder)): path.lstat() for path in self.folder.rglob("*")}
        return {
            name: (one.st_ino, 0 if path.is_dir() else one.st_size)
            for name, one in facts.items()
            for path in [self.folder / name]
        }

    def changed(self) -> set[str]:
        """What is new, replaced or gone."""
        return {name for name, _ in self.files().items() ^ self.before.items()}


@pytest.fixture
def place(workshop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Place]]:
    """Makes a fresh copy of the workshop, and runs there."""
    kept, number = Path.cwd(), 0

    def fresh() -> Place:
        nonlocal number
        os.chdir(kept)
        shutil.rmtree(tmp_path / f"place{number}", ignore_errors=True)
        number += 1
        made = Place(workshop, tmp_path / f"place{number}")
        os.chdir(made.folder)
        return made

    yield fresh
    os.chdir(kept)


def run(line: str, capfd: pytest.CaptureFixture[str], seconds: int = 60) -> tuple[int, str]:
    """The exit code of a command line, and what it says on stderr. One that takes longer is ended."""
    capfd.readouterr()
    signal.alarm(seconds)
    try:
        code = main(line.split())
    finally:
        signal.alarm(0)
    return code, capfd.readouterr().err


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    def ring(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    yield
    signal.signal(signal.SIGALRM, before)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def listening(path: Path) -> None:
    os.chdir(path.parent)  # names of sockets are short
    socket.socket(socket.AF_UNIX).bind(path.name)


@pytest.mark.parametrize("make", [pipe, endless, listening, Path.mkdir])
def test_only_files_are_opened(
    place: Callable[[], Place], capfd: pytest.CaptureFixture[str], make: Callable[[Path], None]
) -> None:
    wrong = {}
    for name, line in READS.items():
        there = place()
        if not (there.folder / name).is_file():
            continue
        (there.folder / name).unlink()
        make(there.folder / name)
        os.chdir(there.folder)
        try:
            code, said = run(line, capfd, 20)
        except TimeoutError:
            code, said = -1, "it hangs"
        if code != 2 or "Traceback" in said:
            wrong[name] = (code, said)
    assert not wrong


def derived_names(there: Place, line: str) -> list[str]:
    """The files that a command line wrote and does not name."""
    named = {os.path.normpath(word) for word in line.split()}
    written = {name for name in there.changed() if (there.folder / name).is_file()}
    return sorted(name for name in written - named if ".packed/" not in name)  # called after the samples' times


@pytest.mark.parametrize("line", LINES)
def test_a_name_that_is_derived_overwrites_nothing_of_the_users(
    line: str, place: Callable[[], Place], capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    there = place()
    run(line, capfd)
    for name in derived_names(there, line):
        for linked in (False, True):
            there = place()
            (there.folder / name).parent.mkdir(exist_ok=True)
            (there.folder / name).unlink(missing_ok=True)
            (tmp_path / "elsewhere").write_bytes(MINE)
            if linked:
                (there.folder / name).symlink_to(tmp_path / "elsewhere")
            else:
                (there.folder / name).write_bytes(MINE)
            code, said = run(line, capfd)
            assert (there.folder / name).read_bytes() == MINE, (name, said)
            assert (tmp_path / "elsewhere").read_bytes() == MINE
            if not name.endswith("job.lock"):  # which keeps what it holds
                assert code == 2 and name.split("/")[-1] in said, (code, said)
            if not linked:
                assert run(f"{line} --overwrite", capfd)[0] == 0
