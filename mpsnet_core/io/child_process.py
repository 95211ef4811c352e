"""Child processes that answer in JSON lines: the parent's side, :class:`ChildProcess`, the child's :class:`Parent`.

A request is a JSON object on one line of the child's stdin. A message is a JSON object on one line of its stdout::

    {"ready": true}                             it accepts requests
    {"progress": 0.4, "message": "reading"}     its progress
    {"result": {...}}                           the result of a request
    {"error": "a sentence"}                     why a request failed

The end of everything else that a child prints, and of its stderr, is kept for error messages.
"""

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from mpsnet_core.errors import FileError, FormatError
from mpsnet_core.io.files import remove_own_unfinished

# Longer or endless lines are read in pieces, and are neither messages nor requests.
LONGEST_LINE = 1 << 22
LAST_WORDS = 20
LONGEST_WORDS = 2000
CLOSE_SECONDS = 5.0
# What a child that is asked to end has left to do so by itself.
CANCEL_SECONDS = 0.8

_KINDS: dict[str, type | tuple[type, ...]] = {"ready": bool, "progress": (int, float), "result": dict, "error": str}


# --- the parent's side ------------------------------------------------------------------------------------------------


class ChildEnded(Exception):
    """A child process ended without an answer. The message says how, with the last lines that it printed.

    code: its exit code, negative for a signal, None if it was ended because it did not answer.
    """

    def __init__(self, how: str, code: int | None = None) -> None:
        super().__init__(how)
        self.code = code


class ChildProcess:
    """A child process in its own process group. Only one thread at a time may send and receive.

    The attributes `progress` (0 to 1) and `message` hold its progress. Raises FileError if the command cannot be run.
    """

    # On Windows, a process that starts while another one's pipes are created inherits them, and keeps them open.
    _starting = threading.Lock()

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self.progress, self.message = 0.0, "starting"
        self._messages = queue.SimpleQueue[dict[str, Any] | None]()
        self._words = deque[str](maxlen=LAST_WORDS)
        try:
            with self._starting:
                self._process = subprocess.Popen(
                    list(command),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    encoding="utf-8",
                    errors="replace",
                    env=dict(environment),
                    # A process group: its own children end with it, Ctrl-C reaches the parent alone, and CTRL_BREAK of
                    # Windows reaches the child.
                    start_new_session=sys.platform != "win32",
                    creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
                )
        except OSError as error:
            raise FileError(f"cannot run {command[0]} ({error.strerror}); check the path") from None
        self._stderr_reader = threading.Thread(target=self._read_stderr, daemon=True)
        self._stderr_reader.start()
        for work in (self._read_messages, self._end_group):
            threading.Thread(target=work, daemon=True).start()

    @property
    def pid(self) -> int:
        return self._process.pid

    def running(self) -> bool:
        return self._process.poll() is None

    def wait(self, seconds: float | None = None) -> int:
        """Wait until it ends, and return its exit code. Raises subprocess.TimeoutExpired."""
        return self._process.wait(seconds)

    def send(self, request: Mapping[str, Any]) -> None:
        """Send a request. If the child does not read it, :meth:`receive` raises."""
        stdin = self._process.stdin
        assert stdin
        with contextlib.suppress(OSError, ValueError):  # broken or closed
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()

    def receive(self, seconds: float | None = None) -> dict[str, Any]:
        """The next message that is not about progress.

        Raises ChildEnded if the process has ended. Without a message within `seconds`, it is ended.
        """
        try:
            message = self._messages.get(timeout=seconds)
        except queue.Empty:
            self.kill()
            raise ChildEnded(f"no answer in {seconds:g} s{self._last_words()}") from None
        if message is not None:
            return message
        self._messages.put(None)
        self._end_within(CLOSE_SECONDS)  # it may have closed its stdout and still run
        code = self.wait()
        # Codes of Windows, such as 0xC0000005 for a crash, are known in hexadecimal.
        how = f"signal {-code}" if code < 0 else f"exit code {f'0x{code:X}' if code >> 31 else code}"
        raise ChildEnded(f"{how}{self._last_words() or '; it printed nothing'}", code)

    def close(self) -> None:
        """End an idle child by closing its stdin."""
        self._close_stdin()
        self._end_within(CLOSE_SECONDS)

    def cancel(self, seconds: float) -> None:
        """Ask the process to end by a signal, and kill it after `seconds`."""
        if not self.running():
            return
        with contextlib.suppress(OSError):
            if sys.platform == "win32":
                self._process.send_signal(signal.CTRL_BREAK_EVENT)
            else:
                self._process.terminate()
        self._end_within(seconds)

    def kill(self) -> None:
        """Kill it and its children at once, from any thread."""
        if self.running():
            self._kill_group()
        self.wait()
        self._close_stdin()

    def _end_within(self, seconds: float) -> None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(seconds)
        self.kill()

    def _end_group(self) -> None:
        """End the children that an ended process left: they hold its pipes open, which would block the readers."""
        self.wait()
        self._kill_group()

    def _kill_group(self) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # it has ended, without children
            if sys.platform == "win32":
                self._process.kill()
            else:
                os.killpg(self.pid, signal.SIGKILL)

    def _close_stdin(self) -> None:
        assert self._process.stdin
        with contextlib.suppress(OSError):
            self._process.stdin.close()

    def _last_words(self) -> str:
        self._stderr_reader.join(2)  # on Windows, its children may hold its stderr open
        words = " ".join(" ".join(self._words).split()[-60:])
        return f"; its last words: {words[-300:]}" if words else ""

    def _read_messages(self) -> None:
        assert self._process.stdout
        with self._process.stdout as pipe:
            for line in _lines(pipe):
                message = _parsed(line)
                kind = next((kind for kind in _KINDS if kind in message), "")
                if not kind or not isinstance(message[kind], _KINDS[kind]):
                    self._words.append(line.strip()[-LONGEST_WORDS:])
                elif kind == "progress":
                    self.progress, self.message = message["progress"], str(message.get("message", ""))
                else:
                    self._messages.put(message)
        self._messages.put(None)

    def _read_stderr(self) -> None:
        assert self._process.stderr
        with self._process.stderr as pipe:
            self._words.extend(line.strip()[-LONGEST_WORDS:] for line in _lines(pipe) if line.strip())


def child_environment(*homes: Path, isolated: bool = False) -> dict[str, str]:
    """This process's environment, with which a child can import this package, and packages in the folders `homes`.

    Nothing is imported from the current folder, which may hold untrusted files. isolated: nor from the user's site
    packages and PYTHONPATH.
    """
    environment = {**os.environ, "PYTHONSAFEPATH": "1"}
    places = [str(home) for home in (Path(__file__).parents[2], *homes)]
    if isolated:
        environment.pop("PYTHONHOME", None)
        environment["PYTHONNOUSERSITE"] = "1"
    else:
        places += filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))
    return {**environment, "PYTHONPATH": os.pathsep.join(dict.fromkeys(places)), "PYTHONIOENCODING": "utf-8"}


# --- the child's side -------------------------------------------------------------------------------------------------


class ParentGone(Exception):
    """The parent no longer reads messages."""


class Parent:
    """The process that started this one. It reserves stdout for messages: all other output to stdout goes to stderr."""

    def __init__(self) -> None:
        sys.stdout.flush()
        self._messages = os.fdopen(os.dup(1), "w", encoding="ascii", newline="\n")
        os.dup2(2, 1)  # Blender prints there

    def send(self, **message: Any) -> None:
        """Send a message. Raises ParentGone."""
        try:
            self._messages.write(json.dumps(message) + "\n")
            self._messages.flush()
        except OSError:
            raise ParentGone from None


def requests() -> Iterator[dict[str, Any]]:
    """The requests on stdin, until it ends. Raises FormatError if a line is no request."""
    for line in _lines(sys.stdin) if sys.stdin else ():
        request = _parsed(line)
        if not request:
            raise FormatError(f"{line.strip()!r} is not a request; give a JSON object a line")
        yield request


def only_request() -> dict[str, Any]:
    """The only request of this process, empty if there is none. Raises FormatError if it is malformed.

    If stdin ends later, the parent is gone, and this process stops as the parent would cancel it: by SIGTERM, and if it
    does not hear that, by force. On Windows it continues: while a thread waits for stdin there, libraries that access
    stdin cannot be loaded.
    """
    request = next(requests(), {})
    if sys.platform != "win32":
        threading.Thread(target=_stop_without_parent, daemon=True).start()
    return request


def _stop_without_parent() -> None:
    with contextlib.suppress(OSError):
        while os.read(0, LONGEST_LINE):  # not sys.stdin, whose lock would block the exit of the process
            pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(CANCEL_SECONDS)  # Python hears a signal only between two calls: a render is one call
    remove_own_unfinished()
    if os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os.kill(os.getpid(), signal.SIGKILL)


def _lines(pipe: IO[str]) -> Iterator[str]:
    return iter(lambda: pipe.readline(LONGEST_LINE), "")


def _parsed(line: str) -> dict[str, Any]:
    """A line's JSON object, empty if it is none."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
