"""The core as a child process: it can neither freeze nor crash Blender, and ending it cancels it.

Another Blender that speaks the same protocol can be the child, too: see background_render.py.
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

from mpsnet_core.cli import EXIT_BAD_INPUT, EXIT_CANCELLED
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.child_process import CANCEL_SECONDS, ChildEnded, ChildProcess, child_environment
from mpsnet_core.io.files import VIDEO_DECODER, remove_unfinished
from mpsnet_core.operation import Operation, to_json

from ..preferences import PACKAGE

# What a child does: an operation of the core, or the request of another program.
Work = Operation | Mapping[str, Any]


class CoreCrashed(Exception):
    """A child process ended without a result. The message includes the last lines that it printed."""


@dataclass(frozen=True)
class Program:
    """A program that speaks the protocol of :mod:`mpsnet_core.io.child_process`, for a child process."""

    command: tuple[str, ...]
    """The program and its arguments."""
    name: str
    """For messages."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Variables that override this process's."""


CORE = Program((sys.executable, "-m", "mpsnet_core", "job", "--progress", "json"), "the core")


class CoreProcess:
    """One run of a program, which starts at construction and ends at the latest when the object is garbage collected.

    outputs: files that the run writes. Unfinished files in their folders are removed after a kill.
    """

    def __init__(self, work: Work, outputs: Sequence[Path] = (), program: Program = CORE) -> None:
        request = to_json(work) if isinstance(work, Operation) else work
        self._name, self._folders = program.name, {output.parent for output in outputs}
        self._child = ChildProcess(program.command, {**_environment(), **program.environment})
        # Also runs if Blender quits during the work.
        weakref.finalize(self, _end, self._child, self._folders)
        # A pipe may hold less than the request until the child has started.
        threading.Thread(target=self._child.send, args=(request,), daemon=True).start()

    @property
    def progress(self) -> float:
        """The fraction done, 0 to 1."""
        return self._child.progress

    @property
    def message(self) -> str:
        """The current activity."""
        return self._child.message

    @property
    def pid(self) -> int:
        return self._child.pid

    def running(self) -> bool:
        return self._child.running()

    def result(self) -> dict[str, Any]:
        """Wait for the end and return the result.

        Raises InputError with the core's sentence on bad input, Cancelled, or CoreCrashed.
        """
        try:
            message = self._child.receive()
            # Bad input also ends a batch that lists it in its result.
            if self._child.wait() not in (0, EXIT_BAD_INPUT) and "error" not in message:
                self._child.receive()  # raises if it crashed after the result
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
        """End the child within a second. No partly written file remains."""
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
    """An environment in which the child finds this process's packages: those of an extension are not on Python's path.

    With pip's bpy they are, except this project's own packages if run from its folder.
    """
    home = Path(__file__).parents[2] if bpy.app.module else Path(numpy.__file__).parents[1]
    return {**child_environment(home, isolated=True), VIDEO_DECODER: json.dumps(blender_command("decode"))}


def blender_command(*verb: str) -> list[str]:
    """The command that starts another Blender, without a window, with a verb of commands.py."""
    if bpy.app.module:
        return [sys.executable, "-m", "blender_addon", *verb]
    # If the extension was just enabled, the preferences may not be saved yet.
    return [bpy.app.binary_path, "-b", "--addons", PACKAGE, "--command", "mpsnet", *verb]


def _end(child: ChildProcess, folders: set[Path]) -> None:
    """End the child, by force if necessary, and remove its unfinished files. Does nothing if it has ended."""
    if child.running():
        child.cancel(CANCEL_SECONDS)
        _clear(child.pid, folders)


def _clear(pid: int, folders: set[Path]) -> None:
    for folder in folders:
        remove_unfinished(folder, pid)
