"""Rules that hold for every verb: what it opens, what it overwrites, what it leaves.

Each test walks over the command lines of :mod:`workshop`.
"""

import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from workshop import READS, VERBS

from mpsnet_core.cli import main
from mpsnet_core.cli.command import OPERATIONS
from mpsnet_core.operation import settings

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform == "win32", reason="pipes and links of POSIX")]

LINES = list(dict.fromkeys([*READS.values(), *VERBS]))
MINE = b"mine"


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


class Hangs(BaseException):
    """A command takes too long. No exception that commands catch."""


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
        raise Hangs

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
def test_only_files_are_opened(place: Callable[[], Place], capfd, make: Callable[[Path], None]) -> None:
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
        except Hangs:
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
def test_a_name_that_is_derived_overwrites_nothing_of_the_users(line: str, place: Callable[[], Place], capfd, tmp_path):
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


# Runs command lines, one a line of stdin, each in a fresh copy of a folder; prints what each came to as JSON.
EACH = """
import contextlib, io, json, os, resource, shutil, sys
from pathlib import Path
from mpsnet_core.cli import main
workshop, folder, most_bytes = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
watched = [Path(os.environ[name]) for name in ("HOME", "TMPDIR")]

def found(place):
    return {str(path.relative_to(place)): path.lstat().st_ino for path in place.rglob("*")}

for number, line in enumerate(sys.stdin.read().splitlines()):
    here = folder / str(number)
    shutil.copytree(workshop, here, copy_function=os.link)
    os.chdir(here)
    before, said = found(here), io.StringIO()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    if most_bytes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, limits[1]))
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            code = main(line.split())
        except SystemExit as left:
            code = left.code
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    changed = sorted({name for name, _ in found(here).items() ^ before.items()})
    left = [str(path) for place in watched for path in place.rglob("*")]
    print(json.dumps([line, code, said.getvalue(), changed, left]), flush=True)
    os.chdir(folder)
    shutil.rmtree(here)
    for place in watched:
        shutil.rmtree(place)
        place.mkdir()
"""


def run_each(lines: list[str], workshop: Path, tmp_path: Path, most_bytes: int = 0) -> list[tuple[Any, ...]]:
    """Command line, exit code, stderr, changed files, and what is left in HOME and TMPDIR, for each command line."""
    places = {name: tmp_path / name.lower() for name in ("HOME", "TMPDIR")}
    for place in (*places.values(), tmp_path / "here"):
        place.mkdir()
    homes = {name: "" for name in os.environ if name.startswith("XDG_") or name == "TORCHINDUCTOR_CACHE_DIR"}
    environment = {name: value for name, value in os.environ.items() if name not in homes}
    environment |= {name: str(place) for name, place in places.items()}
    command = [sys.executable, "-c", EACH, str(workshop), str(tmp_path / "here"), str(most_bytes)]
    done = subprocess.run(command, input="\n".join(lines), env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def test_only_what_was_asked_for_is_stored(workshop: Path, tmp_path: Path) -> None:
    """Nothing in HOME, TMPDIR or beside the inputs. All that is called o... was asked for."""
    wrong = []
    for line, code, said, changed, left in run_each(LINES, workshop, tmp_path):
        named = [word for flag, word in itertools.pairwise(line.split()) if flag in ("-o", "--height", "--json")]
        asked = ("o", *named, *(["job"] if line.startswith("make") else []))
        others = [name for name in changed if not name.startswith(asked)]
        if code not in (0, 2) or others or left or (code == 2 and "empty" not in line):
            wrong.append((line, code, said, others, left))
    assert not wrong


def test_a_full_disk_is_one_sentence_and_leaves_nothing(workshop: Path, tmp_path: Path) -> None:
    """Files may have 300 bytes: after the smallest ones, writing fails as on a full disk."""
    wrong = []
    for line, code, said, changed, left in run_each(LINES, workshop, tmp_path, 300):
        partial = [name for name in changed if "unfinished" in name]
        if code not in (0, 2) or "Traceback" in said or partial or left:
            wrong.append((line, code, said, changed, left))
    assert not wrong


OUTPUTS = ("output", "json", "overlay", "height", "mesh", "curvature", "occlusion", "relit", "confidence", "albedo")


def test_no_output_that_is_a_folder_is_a_fault(workshop: Path, tmp_path: Path) -> None:
    """-o . and -o / and their like: one sentence."""
    kinds = {kind.command: kind for kind in OPERATIONS}
    lines = []
    for command, kind in kinds.items():
        for line in [line for line in LINES if line.startswith(f"{command} ")][:1]:
            names = {setting.name: setting.flags[-1] for setting in settings(kind) if setting.name in OUTPUTS}
            lines += [f"{line} {flag}={place}" for flag in names.values() for place in (".", "/", "..", "/etc/o.png/o")]
    wrong = [(line, code, said) for line, code, said, *_ in run_each(lines, workshop, tmp_path) if code not in (0, 2)]
    assert len(lines) > 100 and not wrong
