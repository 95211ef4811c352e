"""Files appear whole or not at all, whatever stops the writing."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import pytest
from synthetic import left_by, listing

from mpsnet_core.cli import _stop
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import (
    atomic_write,
    creatable_folder,
    remove_abandoned,
    remove_file,
    remove_unfinished,
    unfinished_path,
    writable_path,
    write_json,
    write_transaction,
)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows flushes no folders")
def test_a_file_is_on_the_disk_before_its_name_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is flushed, by its inode, and what the folder held when it was."""
    flushed, flush = [], os.fsync

    def watched(handle: int) -> None:
        flushed.append((os.fstat(handle).st_ino, os.fstat(handle).st_size, (tmp_path / "a.json").exists()))
        flush(handle)

    monkeypatch.setattr(os, "fsync", watched)
    write_json(tmp_path / "a.json", {"a": 1})
    file, folder = (tmp_path / "a.json").stat(), tmp_path.stat()
    assert [entry[::2] for entry in flushed] == [(file.st_ino, False), (folder.st_ino, True)]
    assert flushed[0][1] == file.st_size


def test_files_of_a_block_appear_at_its_end_and_what_is_removed_goes_then(tmp_path: Path) -> None:
    for name in ("b.json", "c.json"):
        write_json(tmp_path / name, {})
    with write_transaction():
        write_json(tmp_path / "a.json", {})
        with write_transaction():
            write_json(tmp_path / "b.json", {"new": True})
            remove_file(tmp_path / "c.json")
        with contextlib.suppress(InputError):
            write_json(tmp_path / "no" / "d.json", {})
        assert not (tmp_path / "a.json").exists() and (tmp_path / "c.json").exists()
        assert "new" not in (tmp_path / "b.json").read_text()
    assert listing(tmp_path) == ["a.json", "b.json"]
    assert "new" in (tmp_path / "b.json").read_text()
    remove_file(tmp_path / "a.json")
    with pytest.raises(KeyboardInterrupt), write_transaction():
        remove_file(tmp_path / "b.json")
        write_json(tmp_path / "c.json", {})
        raise KeyboardInterrupt
    assert listing(tmp_path) == ["b.json"]


@pytest.mark.parametrize("stopped_by", [InputError, KeyboardInterrupt])
def test_what_stops_the_writing_leaves_the_old_file_alone(tmp_path: Path, stopped_by: type[BaseException]) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(stopped_by), atomic_write(target) as unfinished:
        unfinished.write_text("half")
        raise stopped_by("stopped")
    assert target.read_text() == "old"
    assert listing(tmp_path) == ["a.txt"]


@pytest.mark.long
def test_a_signal_at_any_time_leaves_all_files_old_or_all_new_and_no_litter(tmp_path: Path) -> None:
    """The command line's own handler runs at each call in turn: Python handles signals where a function begins, and
    after one that is written in C."""

    def write_two(folder: Path) -> None:
        writable_path(folder / "a.txt")
        with write_transaction():
            for name in ("a.txt", "b.txt"):
                with atomic_write(folder / name) as unfinished:
                    unfinished.write_text("new")

    def signal_at(number: int) -> Callable[[FrameType, str, object], None]:
        times = itertools.count()

        def profile(frame: FrameType, event: str, argument: object) -> None:
            if event in ("call", "c_return") and next(times) == number:
                _stop(signal.SIGTERM, frame)

        return profile

    stopped, ran_through = 0, 0
    for number in itertools.count():
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "a.txt").write_text("old")
        before = sys.getprofile()
        try:
            sys.setprofile(signal_at(number))
            write_two(folder)
            ran_through += 1  # a file is being removed, or there are not so many calls
        except KeyboardInterrupt:
            stopped, ran_through = stopped + 1, 0
        finally:
            sys.setprofile(before)
        state = {path.name: path.read_text() for path in folder.iterdir()}
        assert state in ({"a.txt": "old"}, {"a.txt": "new", "b.txt": "new"}), f"at call {number}"
        if ran_through == 300:
            break
    assert stopped > 300


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="a folder that takes no files, whoever asks")
@pytest.mark.parametrize("place", [writable_path, lambda path: creatable_folder(path, "pictures")])
def test_a_folder_that_takes_no_files_is_reported_before_the_work(place: Callable[[str], Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written to; choose another folder"):
        place("/proc/new")
    with pytest.raises(InputError, match=r"^cannot put the pictures into /proc: /proc cannot be written to"):
        creatable_folder("/proc", "pictures")
    assert place(str(tmp_path / "new")) == tmp_path / "new"
    assert listing(tmp_path) == []


def killed_while_writing(path: Path) -> tuple[int, Path]:
    """The number of a process that ended in the middle of writing a file, and what it left."""
    code = "import os, sys; from mpsnet_core.io.files import atomic_write\n" + (
        "with atomic_write(sys.argv[1]) as unfinished: unfinished.write_text('half'); os._exit(9)"
    )
    before = set(path.parent.iterdir())
    child = subprocess.Popen([sys.executable, "-c", code, path])
    assert child.wait(60) == 9
    (left,) = set(path.parent.iterdir()) - before
    return child.pid, left


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    pid, _ = killed_while_writing(tmp_path / "out.png")
    (tmp_path / "keep.png").touch()
    other = left_by(pid + 1, tmp_path / "out.png")
    other.touch()
    remove_unfinished(tmp_path, pid)
    assert listing(tmp_path) == sorted(["keep.png", other.name])


def test_the_next_run_removes_what_one_that_was_killed_left_but_not_what_one_is_writing(tmp_path: Path) -> None:
    killed_while_writing(tmp_path / "out.png")
    alive = left_by(os.getppid(), tmp_path / "out.png")
    alive.touch()
    with atomic_write(tmp_path / "out.png") as unfinished:
        unfinished.write_text("whole")
    assert listing(tmp_path) == sorted(["out.png", alive.name])


def test_what_another_host_writes_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No process of this host has the number, which says nothing of that one."""
    pid, left = killed_while_writing(tmp_path / "out.png")
    monkeypatch.setattr("mpsnet_core.io.files._place", lambda: "0badc0de")
    remove_abandoned(tmp_path)
    remove_unfinished(tmp_path, pid)
    assert listing(tmp_path) == [left.name]


@pytest.mark.skipif(sys.platform == "win32", reason="links need permission")
def test_no_link_that_was_laid_before_is_written_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names cannot be foreseen; one that is taken all the same is not used."""
    names = []
    for _ in range(2):
        with atomic_write(tmp_path / "out.txt") as unfinished:
            assert unfinished.is_file()
            names.append(unfinished.name)
    assert len(set(names)) == 2
    (tmp_path / "mine").write_text("mine")
    monkeypatch.setattr("secrets.token_hex", lambda size: "00" * size)
    unfinished_path(tmp_path / "out.txt").symlink_to("mine")
    with pytest.raises(InputError, match=r"cannot write .*out\.txt"), atomic_write(tmp_path / "out.txt"):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.skipif(sys.platform == "win32", reason="links need permission")
def test_a_file_is_written_where_a_link_leads(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir()
    for name, target in (("old", "shared/old.json"), ("new", "shared/new.json"), ("lost", "gone/x.json")):
        (tmp_path / f"{name}.json").symlink_to(target)
    (tmp_path / "shared" / "old.json").write_text("old")
    with write_transaction():
        for name in ("old", "new"):
            write_json(tmp_path / f"{name}.json", {"a": 1})
    assert listing(tmp_path / "shared") == ["new.json", "old.json"]
    for name in ("old", "new"):
        assert (tmp_path / f"{name}.json").is_symlink()
        assert json.loads((tmp_path / "shared" / f"{name}.json").read_text()) == {"a": 1}
    with pytest.raises(InputError, match=r"cannot write .*lost\.json: the folder .*gone does not exist"):
        writable_path(tmp_path / "lost.json")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has none")
def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link.json").symlink_to("pipe")
    for name in ("pipe", "link.json"):
        with pytest.raises(InputError, match=rf"cannot write .*{name}: it is a pipe"):
            write_json(tmp_path / name, {})
    assert (tmp_path / "pipe").is_fifo()
