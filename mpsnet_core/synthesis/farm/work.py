"""Work: a process that makes the samples that are requested of it, from within (`serve`) and from without (`Worker`).

A worker is started with the job's folder. Its protocol is that of :mod:`mpsnet_core.io.child_process`::

    {"ready": true}                                        first, or {"error": "a sentence"}, and it ends
    {"number": 7}                                          a request
    {"result": {"number": 7, "state": "made"}}             written whole
    {"result": {"number": 7, "state": "there"}}            it was there already
    {"result": {"number": 7, "state": "held"}}             another process is making it
    {"result": {"number": 7, "state": "failed", "error": "a sentence"}}

It ends at the end of its input, so that no worker outlives its parent. A sample that a worker was making when it died
is nobody's: its claim is gone with the process, and :func:`clear_unfinished` clears what it left.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.child_process import ChildEnded, ChildProcess, Parent, ParentGone, child_environment, requests
from mpsnet_core.io.claims import Claims
from mpsnet_core.io.files import check_no_link, remove_abandoned
from mpsnet_core.io.image_writing import is_whole
from mpsnet_core.synthesis.job import SampleJob, read_job, sample_number, sample_path

# In a worker's command: the Python that starts it, which on another machine stands elsewhere.
THIS_PYTHON = "{python}"
# How many threads a worker's renderer may use.
THREADS_VARIABLE = "MPSNET_THREADS"

START_SECONDS = 300.0

State = Literal["made", "there", "held", "failed"]


@dataclass(frozen=True)
class Answer:
    """What became of a sample. error: a sentence, where it failed."""

    number: int
    state: State
    error: str = ""


# What workers answer, as it comes, and None where nothing came for a moment. Closing it ends the workers.
Answers = Generator[Answer | None, None, None]


# --- from within ------------------------------------------------------------------------------------------------------


def serve(folder: str | os.PathLike[str], make: Callable[[SampleJob, int, Path], None]) -> None:
    """Make samples of the job in `folder` as they are requested, until the input ends or nobody reads the answers.

    From here on stdout is stderr for everybody else: the answers have it for themselves.

    make: writes the sample of a number to a path, whole (:func:`mpsnet_core.io.files.written_whole`) or not at all. An
        InputError that it raises is that sample's failure, and the next one is made.
    """
    parent = Parent()
    with contextlib.suppress(ParentGone):
        try:
            job = read_job(folder)
            with Claims(folder) as claims:
                parent.send(ready=True)
                for request in requests():
                    number = _requested(request)
                    with claims.claim(number) as ours:
                        path = sample_path(folder, number)
                        answer = _made(job, number, path, make) if ours else Answer(number, "held")
                    parent.send(result=asdict(answer))
        except InputError as error:
            parent.send(error=str(error))


def _requested(request: Mapping[str, Any]) -> int:
    number = request.get("number")
    if type(number) is not int or not 0 <= number < 10**8:
        raise FormatError(f'{request} does not request a sample; send {{"number": 7}}')
    return number


def _made(job: SampleJob, number: int, path: Path, make: Callable[[SampleJob, int, Path], None]) -> Answer:
    try:
        if is_whole(path):
            return Answer(number, "there")
        check_no_link(path)
        make(job, number, path)
    except InputError as error:
        return Answer(number, "failed", str(error))
    except OSError as error:
        return Answer(number, "failed", f"{error.filename or path}: {error.strerror or error}; check the path")
    except MemoryError:
        return Answer(number, "failed", "there is not enough memory; take a smaller size or fewer processes")
    return Answer(number, "made")


def clear_unfinished(folder: str | os.PathLike[str]) -> None:
    """Remove what processes that were killed left in `folder`, and nothing that another process is writing."""
    remove_abandoned(folder)
    # What is left may be another host's. Whoever writes a sample, anywhere, holds its claim.
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


class Worker:
    """A worker process, started when it is first needed and anew after it died. One thread has it make samples.

    command: what starts it; the folder is added at the end. threads: how many it may use. seconds: how long it may take
    for a sample.
    """

    def __init__(
        self, command: Sequence[str], folder: str | os.PathLike[str], threads: int = 1, *, seconds: float
    ) -> None:
        self._command = [sys.executable if part == THIS_PYTHON else part for part in command]
        self._folder, self._threads, self._seconds = Path(folder), threads, seconds
        self._child: ChildProcess | None = None
        self._lock, self._ended = threading.Lock(), False

    def make(self, number: int) -> Answer:
        """Have a sample made. One that the worker dies of, or does not answer to, is tried once more by a new one.

        Raises InputError where the worker cannot be started or is none of ours, ChildEnded where :meth:`end` ended it.
        """
        for attempt in (1, 2):
            try:
                child = self._child if self._child and self._child.running() else self._start()
                child.send({"number": number})
                return self._answer(number, child.receive(self._seconds))
            except ChildEnded as death:
                if self._ended:
                    raise
                if is_whole(sample_path(self._folder, number)):
                    return Answer(number, "made")  # it died between writing and answering
                if attempt == 2:
                    return Answer(number, "failed", f"the worker died of it twice ({death})")
        raise AssertionError

    def end(self) -> None:
        """End the process at once, from any thread; what it left unfinished is for :func:`clear_unfinished`."""
        with self._lock:
            self._ended = True
        if self._child is not None:
            self._child.kill()

    def close(self) -> None:
        """End the process gently, where it has not ended: it is idle. Called by the thread that has it make samples."""
        if self._child is not None:
            self._child.close()

    def _start(self) -> ChildProcess:
        with self._lock:
            if self._ended:
                raise ChildEnded("it was ended")
            command = [*self._command, str(self._folder)]
            self._child = child = ChildProcess(command, {**child_environment(), **_threads(self._threads)})
        try:
            message = child.receive(START_SECONDS)
        except ChildEnded as death:
            if self._ended:
                raise
            words = " ".join(command)
            raise InputError(f"the worker cannot start ({death}); run it by hand to see why: {words}") from None
        if "ready" not in message:
            raise self._refusal(message)
        return child

    def _answer(self, number: int, message: Mapping[str, Any]) -> Answer:
        result = message.get("result", {})
        state, error = result.get("state"), result.get("error", "")
        if result.get("number") != number or state not in get_args(State) or not isinstance(error, str):
            raise self._refusal(message)
        if state in ("made", "there") and not is_whole(sample_path(self._folder, number)):
            return Answer(number, "failed", f"its worker says that it is {state}, but it is not in the folder")
        return Answer(number, state, error)

    def _refusal(self, message: Mapping[str, Any]) -> InputError:
        """What to raise where a worker does not answer a request."""
        if "error" in message:
            return InputError(message["error"])
        words = " ".join(self._command)
        return InputError(f"{words} does not answer as a worker does ({message}); is it Blender with this extension?")


def _threads(count: int) -> dict[str, str]:
    """One thread for each library: the workers themselves fill the cores, and sums come out the same everywhere."""
    libraries = ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR")
    single = {f"{name}_NUM_THREADS": "1" for name in libraries}
    return {**single, "OPENIMAGEIO_THREADS": "1", THREADS_VARIABLE: str(count)}
