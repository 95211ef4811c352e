"""Work: a process that makes the samples it is asked for, from within (`serve`) and from without (`Worker`).

A worker is started with the job's folder, reads sample numbers from stdin, one a line, and answers each with one JSON
object a line, after a first one that says that it is ready, or why it cannot be::

    {"ready": true}                              or {"error": "a sentence"}, and it ends
    {"number": 7, "answer": "made"}              written whole
    {"number": 7, "answer": "there"}             it was there already
    {"number": 7, "answer": "held"}              another process is making it
    {"number": 7, "answer": "failed", "error": "a sentence"}

It ends at the end of its input, so that no worker outlives the one who asks. A sample that a worker was making when it
died is nobody's: its claim is gone with the process, and :func:`clear_unfinished` clears what it left.
"""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, get_args

import mpsnet_core
from mpsnet_core.errors import InputError
from mpsnet_core.io.claims import Claims
from mpsnet_core.io.files import remove_abandoned
from mpsnet_core.io.images import is_whole
from mpsnet_core.synthesis.job import SampleJob, read_job, sample_number, sample_path

# In a worker's command: the Python that starts it, which on another machine stands elsewhere.
THIS_PYTHON = "{python}"
# How many threads a worker's renderer may use.
THREADS_VARIABLE = "MPSNET_THREADS"

START_SECONDS = 300.0
LAST_WORDS = 20
# Answers are shorter; what is longer, or never ends, is taken piece by piece.
LONGEST_LINE = 1 << 16


# --- from within ------------------------------------------------------------------------------------------------------


def serve(folder: str | os.PathLike[str], make: Callable[[SampleJob, int, Path], None]) -> None:
    """Make samples of the job in `folder` as they are asked for, until the input ends or nobody hears the answers.

    From here on stdout is stderr for everybody else: the answers have it for themselves.

    make: writes the sample of a number to a path, whole (:func:`mpsnet_core.io.files.written_whole`) or not at all. An
        InputError that it raises is told as that sample's failure, and the next one is made.
    """
    sys.stdout.flush()
    answers = os.fdopen(os.dup(1), "w", encoding="ascii", newline="\n")
    os.dup2(2, 1)  # Blender prints there

    with contextlib.suppress(_Unheard):
        try:
            job = read_job(folder)
            claims = Claims(folder)
        except InputError as error:
            return _answer(answers, error=str(error))
        with claims:
            _answer(answers, ready=True)
            for line in sys.stdin:
                if not re.fullmatch(r"\d{1,8}", line.strip()):
                    return _answer(answers, error=f"{line.strip()!r} is not a sample's number; give one a line")
                number = int(line)
                with claims.claim(number) as ours:
                    said = _make(job, number, sample_path(folder, number), make) if ours else {"answer": "held"}
                _answer(answers, number=number, **said)


class _Unheard(Exception):
    """The one who asked has gone."""


def _answer(answers: IO[str], **said: Any) -> None:
    try:
        answers.write(json.dumps(said) + "\n")
        answers.flush()
    except OSError:
        raise _Unheard from None


def _make(job: SampleJob, number: int, path: Path, make: Callable[[SampleJob, int, Path], None]) -> dict[str, str]:
    try:
        if is_whole(path):
            return {"answer": "there"}
        make(job, number, path)
    except InputError as error:
        return {"answer": "failed", "error": " ".join(str(error).split())}
    except OSError as error:
        return {"answer": "failed", "error": f"{error.filename or path}: {error.strerror or error}; check the path"}
    except MemoryError:
        return {"answer": "failed", "error": "there is not enough memory; take a smaller size or fewer processes"}
    return {"answer": "made"}


def clear_unfinished(folder: str | os.PathLike[str]) -> None:
    """Remove what processes that were killed left in `folder`, and nothing that another process is writing."""
    remove_abandoned(folder)
    # What is left is another host's, say. Whoever writes a sample, anywhere, holds its claim.
    found = [(sample_number(path.name), path) for path in Path(folder).glob(".*.unfinished*") if path.is_file()]
    left = [(number, path) for number, path in found if number is not None]
    if not left:
        return
    with Claims(folder) as claims:
        for number, path in left:
            with claims.claim(number) as ours:
                if ours:
                    path.unlink(missing_ok=True)


# --- from without -----------------------------------------------------------------------------------------------------


State = Literal["made", "there", "held", "failed"]


@dataclass(frozen=True)
class Answer:
    """What became of a sample. error: a sentence, where it failed."""

    number: int
    state: State
    error: str = ""


# What workers answer, as it comes, and None where nothing came for a moment. Closing it ends the workers.
Answers = Generator[Answer | None, None, None]


class WorkerLost(Exception):
    """A worker ended, by itself or by :meth:`Worker.end`. The message holds its last words."""


class Worker:
    """A worker process, started when it is first needed and anew after it died. One thread asks it.

    command: what starts it; the folder is added at the end. threads: how many it may use.
    """

    # A process that is started while another's pipes are made inherits them on Windows, and keeps them open.
    _starting = threading.Lock()

    def __init__(self, command: Sequence[str], folder: str | os.PathLike[str], threads: int = 1) -> None:
        self._command = [sys.executable if part == THIS_PYTHON else part for part in command]
        self._folder, self._threads = Path(folder), threads
        self._child: subprocess.Popen[str] | None = None
        self._listener: threading.Thread | None = None
        self._words: deque[str] = deque(maxlen=LAST_WORDS)
        self._ended = False

    def make(self, number: int) -> Answer:
        """Have a sample made. One that the worker dies of is tried once more, in a new process.

        Raises InputError where the worker cannot be started or is none of ours, WorkerLost where it was ended.
        """
        for attempt in (1, 2):
            try:
                if self._child is None or self._child.poll() is not None:
                    self._start()
                return self._ask(number)
            except WorkerLost as death:
                if self._ended:
                    raise
                if is_whole(sample_path(self._folder, number)):
                    return Answer(number, "made")  # it died between writing and saying so
                if attempt == 2:
                    return Answer(number, "failed", f"the worker died of it twice ({death})")
        raise AssertionError

    def end(self) -> None:
        """End the process at once, from any thread; what it left unfinished is for :func:`clear_unfinished`."""
        with self._starting:
            self._ended = True
            child = self._child
        if child is not None:
            _kill(child)

    def close(self) -> None:
        """End the process gently, where it has not ended: it is idle, and its input ends. Called by who asks it."""
        child = self._child
        if child is not None and child.stdin is not None:
            with contextlib.suppress(OSError):
                child.stdin.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(5)
        self.end()
        self._release()

    def _start(self) -> None:
        self._release()
        self._words.clear()
        try:
            with self._starting:
                if self._ended:
                    raise WorkerLost("it was ended")
                self._child = subprocess.Popen(
                    [*self._command, str(self._folder)],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    encoding="utf-8",
                    errors="replace",
                    env=_environment(self._threads),
                    # A group of its own: what it starts ends with it, and Ctrl-C is for the one who asks.
                    start_new_session=sys.platform != "win32",
                )
        except OSError as error:
            raise InputError(f"cannot run {self._command[0]} ({error.strerror}); check the path") from None
        self._listener = threading.Thread(target=self._listen, args=(self._child,), daemon=True)
        self._listener.start()
        if sys.platform != "win32":
            threading.Thread(target=_end_group, args=(self._child,), daemon=True).start()
        patience = threading.Timer(START_SECONDS, _kill, (self._child,))
        patience.start()
        try:
            said = self._read()
        except WorkerLost as death:
            if self._ended:
                raise
            words = " ".join([*self._command, str(self._folder)])
            raise InputError(f"the worker cannot start ({death}); run it by hand to see why: {words}") from None
        finally:
            patience.cancel()
        if said.get("ready") is not True:
            raise self._refusal(said)

    def _ask(self, number: int) -> Answer:
        assert self._child and self._child.stdin
        try:
            self._child.stdin.write(f"{number}\n")
            self._child.stdin.flush()
        except OSError:
            raise WorkerLost(self._death()) from None
        said = self._read()
        state: Any = said.get("answer")
        error = said.get("error", "")
        if said.get("number") != number or state not in get_args(State) or not isinstance(error, str):
            raise self._refusal(said)
        if state in ("made", "there") and not is_whole(sample_path(self._folder, number)):
            return Answer(number, "failed", f"its worker says that it is {state}, but it is not in the folder")
        return Answer(number, state, error)

    def _refusal(self, said: dict[str, Any]) -> InputError:
        """What to raise where a worker does not answer what it was asked."""
        if "number" not in said and isinstance(said.get("error"), str):
            return InputError(said["error"])
        words = " ".join(self._command)
        return InputError(f"{words} does not answer as a worker does ({said}); is it Blender with this extension?")

    def _read(self) -> dict[str, Any]:
        assert self._child and self._child.stdout
        for line in _lines(self._child.stdout):
            # Before it is ready, a program may print what it likes: Blender tells its version, for one.
            with contextlib.suppress(ValueError, RecursionError):
                said = json.loads(line)
                if isinstance(said, dict) and said.keys() & {"ready", "answer", "error"}:
                    return said
            self._words.append(line)
        raise WorkerLost(self._death())

    def _death(self) -> str:
        assert self._child and self._listener
        code = self._child.wait()
        self._listener.join(2)
        words = " ".join(" ".join(self._words).split()[-60:])
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"{how}; its last words: {words[-300:]}" if words else f"{how}; it said nothing"

    def _listen(self, child: "subprocess.Popen[str]") -> None:
        assert child.stderr
        with contextlib.suppress(ValueError):  # closed under our eyes
            self._words.extend(line for line in _lines(child.stderr) if line.strip())

    def _release(self) -> None:
        """Close the pipes of a process that has ended."""
        if self._child is None:
            return
        pipes: list[IO[str] | None] = [self._child.stdin, self._child.stdout]
        if self._listener is not None:
            self._listener.join(2)
            # What the process started may have its stderr still, and whoever closes that waits for its reader.
            pipes += [] if self._listener.is_alive() else [self._child.stderr]
        for pipe in pipes:
            with contextlib.suppress(OSError):
                assert pipe
                pipe.close()


def _lines(pipe: IO[str]) -> Iterator[str]:
    return iter(lambda: pipe.readline(LONGEST_LINE), "")


def _kill(child: "subprocess.Popen[str]") -> None:
    if child.poll() is None:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # it ended just now
            if sys.platform == "win32":
                child.kill()
            else:
                os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def _end_group(child: "subprocess.Popen[str]") -> None:
    """Once a process has ended, end what it started and left: that holds its pipes, whose end is waited for."""
    child.wait()
    with contextlib.suppress(ProcessLookupError, PermissionError):  # it left nothing
        os.killpg(child.pid, signal.SIGKILL)


def _environment(threads: int) -> dict[str, str]:
    """One thread for each library: the workers themselves fill the cores, and sums come out the same everywhere.

    A worker finds this package where this process did, which within Blender is not on Python's own path.
    """
    home = str(Path(mpsnet_core.__file__).parents[1])
    homes = dict.fromkeys([home, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))])
    libraries = ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR")
    single = {f"{name}_NUM_THREADS": "1" for name in libraries} | {"OPENIMAGEIO_THREADS": "1"}
    return {
        **os.environ,
        **single,
        THREADS_VARIABLE: str(threads),
        "PYTHONPATH": os.pathsep.join(homes),
        "PYTHONIOENCODING": "utf-8",
    }
