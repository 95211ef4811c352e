"""The core as a child process: it cannot freeze Blender's window, cannot crash it, and is cancelled by ending it.

So can be another Blender that answers as the core does, see render_beside.py.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import bpy
import numpy

import mpsnet_core
from mpsnet_core.cli import EXIT_CANCELLED
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.files import remove_unfinished

CANCEL_SECONDS = 0.8
LAST_WORDS = 20


class CoreCrashed(Exception):
    """A child process ended without a result. The message holds its last words."""


@dataclass(frozen=True)
class Program:
    """What a child process runs: it is called as the core is, with ``--progress json``, and answers as that does.

    name: for people. environment: variables that it has in place of this process's.
    """

    command: tuple[str, ...]
    name: str
    environment: Mapping[str, str] = field(default_factory=dict)


CORE = Program((sys.executable, "-m", "mpsnet_core"), "the core")


@dataclass
class _Said:
    """What the child has said so far; its readers fill it in and know nothing else, so that a run can be dropped."""

    progress: float = 0.0
    message: str = "starting"
    answer: dict[str, Any] = field(default_factory=dict)
    last_words: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_WORDS))


class CoreProcess:
    """One run of a program, from the moment it is made until it ends or nobody holds it any more.

    arguments: verb and options as on the command line.
    outputs: files that the run writes; their folders are cleared of unfinished files after a kill.
    program: what is run, ``python -m mpsnet_core`` unless given.

    Attributes `progress` (0 to 1) and `message` say how far it is.
    """

    def __init__(self, arguments: Sequence[str], outputs: Sequence[Path] = (), program: Program = CORE) -> None:
        self._said, self._name = _Said(), program.name
        self._folders = {output.parent for output in outputs}
        flags = 0
        if sys.platform == "win32":
            # A group of its own, so that the child can be asked to end and not Blender with it.
            flags = subprocess.CREATE_NEW_PROCESS_GROUP
        self._child = subprocess.Popen(
            [*program.command, *arguments, "--progress", "json"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env={**_environment(), **program.environment},
            creationflags=flags,
        )
        # Also runs when Blender quits in the middle of the work.
        weakref.finalize(self, _end, self._child, self._folders)
        assert self._child.stdout and self._child.stderr
        self._readers = [
            threading.Thread(target=_read_answers, args=(self._child.stdout, self._said), daemon=True),
            threading.Thread(target=_read_last_words, args=(self._child.stderr, self._said), daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    @property
    def progress(self) -> float:
        return self._said.progress

    @property
    def message(self) -> str:
        return self._said.message

    @property
    def pid(self) -> int:
        return self._child.pid

    def running(self) -> bool:
        return self._child.poll() is None

    def result(self) -> dict[str, Any]:
        """Wait for the end and give what the core answered.

        Raises InputError with the core's sentence on bad input, Cancelled, or CoreCrashed with its last words.
        """
        code = self._child.wait()
        for reader in self._readers:
            reader.join()
        if code == 0 and "result" in self._said.answer:
            return dict(self._said.answer["result"])
        _clear(self.pid, self._folders)
        if "error" in self._said.answer:
            raise InputError(self._said.answer["error"])
        if code == EXIT_CANCELLED:
            raise Cancelled
        words = self._said.last_words[-1] if self._said.last_words else "it said nothing"
        raise CoreCrashed(f"{self._name} ended unexpectedly (exit code {code}); its last words: {words}")

    def cancel(self) -> None:
        """End the child within a second; nothing half-written stays behind."""
        _end(self._child, self._folders)


def _read_answers(stream: IO[str], said: _Said) -> None:
    for line in stream:
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            said.last_words.append(line.strip())
        elif "progress" in answer:
            said.progress, said.message = answer["progress"], answer["message"]
        else:
            said.answer = answer


def _read_last_words(stream: IO[str], said: _Said) -> None:
    said.last_words.extend(line.strip() for line in stream if line.strip())


def run(
    arguments: Sequence[str],
    outputs: Sequence[Path] = (),
    on_progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Run the core, wait for it, and give its result. Raises as :meth:`CoreProcess.result` does."""
    process = CoreProcess(arguments, outputs)
    try:
        while process.running():
            if on_progress is not None:
                on_progress(process.progress, process.message)
            time.sleep(0.02)
    except BaseException:
        process.cancel()
        raise
    return process.result()


def _environment() -> dict[str, str]:
    """The child finds its packages where this process found them: an extension's are not on Python's own path.

    Beside pip's bpy they are, but for this project's own where they are run from its folder.
    """
    files = [mpsnet_core.__file__, __file__ if bpy.app.module else numpy.__file__]
    homes = [str(Path(file).parents[1]) for file in files if file]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONHOME"}
    environment["PYTHONPATH"] = os.pathsep.join(dict.fromkeys(homes))
    environment["PYTHONIOENCODING"] = "utf-8"
    # Neither the folder that Blender was started in nor the person's own packages have a say in what is imported.
    environment["PYTHONSAFEPATH"] = environment["PYTHONNOUSERSITE"] = "1"
    return environment


def _end(child: "subprocess.Popen[str]", folders: set[Path]) -> None:
    """End the child, by force if need be, and clear the folders of what it left; nothing where it has ended."""
    if child.poll() is not None:
        return
    try:
        if sys.platform == "win32":
            child.send_signal(signal.CTRL_BREAK_EVENT)
        else:
            child.terminate()
        child.wait(CANCEL_SECONDS)
    except (subprocess.TimeoutExpired, OSError):
        child.kill()
        child.wait()
    _clear(child.pid, folders)


def _clear(pid: int, folders: set[Path]) -> None:
    for folder in folders:
        remove_unfinished(folder, pid)
