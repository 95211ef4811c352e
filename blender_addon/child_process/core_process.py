"""The core as a child process: it cannot freeze Blender's window, cannot crash it, and is cancelled by ending it.

So can be another Blender that speaks the same protocol, see background_render.py.
"""

import json
import sys
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy

from mpsnet_core.cli import EXIT_CANCELLED
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.child_process import ChildEnded, ChildProcess, child_environment
from mpsnet_core.io.files import VIDEO_DECODER, remove_unfinished
from mpsnet_core.operation import Operation
from mpsnet_core.operation_json import to_json

from ..preferences import PACKAGE

CANCEL_SECONDS = 0.8

# What a child does: an operation of the core, or the request of another program.
Work = Operation | Mapping[str, Any]


class CoreCrashed(Exception):
    """A child process ended without a result. The message holds its last words."""


@dataclass(frozen=True)
class Program:
    """What a child process runs, which speaks the protocol of :mod:`mpsnet_core.io.child_process`.

    name: for people. environment: variables that it has in place of this process's.
    """

    command: tuple[str, ...]
    name: str
    environment: Mapping[str, str] = field(default_factory=dict)


CORE = Program((sys.executable, "-m", "mpsnet_core", "job", "--progress", "json"), "the core")


class CoreProcess:
    """One run of a program, from the moment it is made until it ends or nobody holds it any more.

    outputs: files that the run writes; their folders are cleared of unfinished files after a kill.
    """

    def __init__(self, work: Work, outputs: Sequence[Path] = (), program: Program = CORE) -> None:
        request = to_json(work) if isinstance(work, Operation) else work
        self._name, self._folders = program.name, {output.parent for output in outputs}
        self._child = ChildProcess(program.command, {**_environment(), **program.environment})
        # Also runs when Blender quits in the middle of the work.
        weakref.finalize(self, _end, self._child, self._folders)
        # A pipe may hold less than the request until the child has started.
        threading.Thread(target=self._child.send, args=(request,), daemon=True).start()

    @property
    def progress(self) -> float:
        """How far it is, 0 to 1."""
        return self._child.progress

    @property
    def message(self) -> str:
        """What it is doing."""
        return self._child.message

    @property
    def pid(self) -> int:
        return self._child.pid

    def running(self) -> bool:
        return self._child.running()

    def result(self) -> dict[str, Any]:
        """Wait for the end and return the result.

        Raises InputError with the core's sentence on bad input, Cancelled, or CoreCrashed with its last words.
        """
        try:
            message = self._child.receive()
            if self._child.wait() and "error" not in message:
                self._child.receive()  # raises: it ended badly all the same
        except ChildEnded as end:
            _clear(self.pid, self._folders)
            if end.code == EXIT_CANCELLED:
                raise Cancelled from None
            raise CoreCrashed(f"{self._name} ended unexpectedly ({end})") from None
        if "error" in message:
            _clear(self.pid, self._folders)
            raise InputError(message["error"])
        return dict(message["result"])

    def cancel(self) -> None:
        """End the child within a second; nothing half-written stays behind."""
        _end(self._child, self._folders)


def run(
    work: Work, outputs: Sequence[Path] = (), on_progress: Callable[[float, str], None] | None = None
) -> dict[str, Any]:
    """Run the core, wait for it, and return its result. Raises as :meth:`CoreProcess.result` does."""
    process = CoreProcess(work, outputs)
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
    home = Path(__file__).parents[2] if bpy.app.module else Path(numpy.__file__).parents[1]
    return {**child_environment(home, isolated=True), VIDEO_DECODER: json.dumps(blender_command("decode"))}


def blender_command(*verb: str) -> list[str]:
    """What starts another Blender, without a window, for a verb of commands.py."""
    if bpy.app.module:
        return [sys.executable, "-m", "blender_addon", *verb]
    # Where the extension was enabled just now, the preferences may not be saved yet.
    return [bpy.app.binary_path, "-b", "--addons", PACKAGE, "--command", "mpsnet", *verb]


def _end(child: ChildProcess, folders: set[Path]) -> None:
    """End the child, by force if need be, and clear the folders of what it left; nothing where it has ended."""
    if child.running():
        child.cancel(CANCEL_SECONDS)
        _clear(child.pid, folders)


def _clear(pid: int, folders: set[Path]) -> None:
    for folder in folders:
        remove_unfinished(folder, pid)
