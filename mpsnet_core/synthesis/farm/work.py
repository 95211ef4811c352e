"""Workers: processes that make samples on request (`serve`), and their handles in the parent (`Worker`).

A worker is started with the job's folder. Its protocol is that of :mod:`mpsnet_core.io.child_process`::

    {"ready": true}                                        first, or {"error": "a sentence"}, and it ends
    {"number": 7}                                          a request
    {"result": {"number": 7, "state": "made"}}             written completely
    {"result": {"number": 7, "state": "there"}}            it existed already
    {"result": {"number": 7, "state": "held"}}             another process is making it
    {"result": {"number": 7, "state": "failed", "error": "a sentence"}}

A worker ends when its input ends, so it does not outlive its parent. If a worker dies, its claim on the current sample
ends with the process, and :func:`clear_unfinished` removes the unfinished file.
"""

import contextlib
import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.child_process import ChildEnded, ChildProcess, Parent, ParentGone, child_environment, requests
from mpsnet_core.io.claims import Claims
from mpsnet_core.io.files import check_no_link, remove_abandoned
from mpsnet_core.io.image_writing import is_complete_image
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.synthesis.job import SampleJob, read_job, sample_number, sample_path

# Placeholder in a worker's command for the Python that starts it, whose path differs between machines.
THIS_PYTHON = "{python}"
# Environment variable with the number of threads of a worker's renderer.
THREADS_VARIABLE = "MPSNET_THREADS"

START_SECONDS = 300.0

State = Literal["made", "there", "held", "failed"]


@dataclass(frozen=True)
class SampleResult:
    """The outcome of a request for a sample."""

    number: int
    """Number of the sample."""
    state: State
    """"made", "there" if it existed, "held" if another process is making it, or "failed"."""
    error: str = ""
    """A sentence, if it failed."""


# Results of workers as they arrive, and None if nothing arrives for a moment. Closing the generator ends the workers.
SampleResults = Generator[SampleResult | None, None, None]

LISTEN_SECONDS = 0.2
# Until a sample that another process holds is asked for again.
RETRY_SECONDS = 0.5
# The submitted tasks are kept in memory; this many keep all workers busy.
TASKS_AHEAD = 2000


def gathered(
    submit: Callable[[Sequence[int]], Any],
    batches: Iterable[Sequence[int]],
    answer: Callable[[Any, Sequence[int]], list[SampleResult] | None],
    pending: dict[Any, Sequence[int]],
) -> SampleResults:
    """Results of the samples of `batches`, each of which is a task of a pool. Samples that are held are asked again.

    submit: gives a batch to the pool, and returns its future. answer: the results of a future that is done and of its
    batch, None to submit it again. pending: filled with the futures that are not done.
    """
    waiting, held = deque(batches), deque[tuple[float, int]]()
    done = queue.SimpleQueue[Any]()
    while waiting or held or pending:
        while held and held[0][0] <= time.monotonic():
            waiting.append((held.popleft()[1],))
        while waiting and len(pending) < TASKS_AHEAD:
            batch = waiting.popleft()
            task = submit(batch)
            pending[task] = batch
            task.add_done_callback(done.put)
        try:
            task = done.get(timeout=LISTEN_SECONDS)
        except queue.Empty:
            yield None
            continue
        batch = pending.pop(task)
        results = answer(task, batch)
        if results is None:
            waiting.append(batch)
        for result in results or ():
            if result.state == "held":
                held.append((time.monotonic() + RETRY_SECONDS, result.number))
            else:
                yield result


# --- from within ------------------------------------------------------------------------------------------------------


def serve(folder: AnyPath, make: Callable[[SampleJob, int, Path], None]) -> None:
    """Make samples of the job in `folder` on request, until the input ends or nobody reads the answers.

    Redirects stdout to stderr for all other code: the real stdout is for answers only.

    make: writes the sample with a number to a path, atomically (:func:`mpsnet_core.io.files.atomic_write`). If it
        raises InputError, that sample has failed, and work continues.
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
                        answer = _made(job, number, path, make) if ours else SampleResult(number, "held")
                    parent.send(result=asdict(answer))
        except InputError as error:
            parent.send(error=str(error))


def _requested(request: Mapping[str, Any]) -> int:
    number = request.get("number")
    if type(number) is not int or not 0 <= number < 10**8:
        raise FormatError(f'{request} does not request a sample; send {{"number": 7}}')
    return number


def _made(job: SampleJob, number: int, path: Path, make: Callable[[SampleJob, int, Path], None]) -> SampleResult:
    try:
        if is_complete_image(path):
            return SampleResult(number, "there")
        check_no_link(path)
        make(job, number, path)
    except InputError as error:
        return SampleResult(number, "failed", str(error))
    except OSError as error:
        return SampleResult(number, "failed", f"{error.filename or path}: {error.strerror or error}; check the path")
    except MemoryError:
        return SampleResult(number, "failed", "there is not enough memory; take a smaller size or fewer processes")
    return SampleResult(number, "made")


def clear_unfinished(folder: AnyPath) -> None:
    """Remove the unfinished files of killed processes from `folder`, but none that another process is writing."""
    remove_abandoned(folder)
    # Files may be from another host. A process that writes a sample, on any host, holds its claim.
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
    """A worker process, started on first use and again after it died. Only one thread may call :meth:`make`.

    command: of the process; the folder is appended. threads: number of threads it may use. seconds: time limit for a
    sample.
    """

    def __init__(self, command: Sequence[str], folder: AnyPath, threads: int = 1, *, seconds: float) -> None:
        self._command = [sys.executable if part == THIS_PYTHON else part for part in command]
        self._folder, self._threads, self._seconds = Path(folder), threads, seconds
        self._child: ChildProcess | None = None
        self._lock, self._ended = threading.Lock(), False

    def make(self, number: int) -> SampleResult:
        """Make a sample. If the worker dies or does not answer, a new one tries once more.

        Raises InputError if the worker cannot be started or does not answer as one, ChildEnded if :meth:`end` ended it.
        """
        for attempt in (1, 2):
            try:
                child = self._child if self._child and self._child.running() else self._start()
                child.send({"number": number})
                return self._answer(number, child.receive(self._seconds))
            except ChildEnded as death:
                if self._ended:
                    raise
                if is_complete_image(sample_path(self._folder, number)):
                    return SampleResult(number, "made")  # it died after writing, before answering
                if attempt == 2:
                    return SampleResult(number, "failed", f"the worker died of it twice ({death})")
        raise AssertionError

    def end(self) -> None:
        """Kill the process, from any thread. :func:`clear_unfinished` removes its unfinished file."""
        with self._lock:
            self._ended = True
        if self._child is not None:
            self._child.kill()

    def close(self) -> None:
        """End the idle process gently, if it still runs. Called by the thread that calls :meth:`make`."""
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

    def _answer(self, number: int, message: Mapping[str, Any]) -> SampleResult:
        result = message.get("result", {})
        state, error = result.get("state"), result.get("error", "")
        if result.get("number") != number or state not in get_args(State) or not isinstance(error, str):
            raise self._refusal(message)
        if state in ("made", "there") and not is_complete_image(sample_path(self._folder, number)):
            return SampleResult(number, "failed", f"its worker says that it is {state}, but it is not in the folder")
        return SampleResult(number, state, error)

    def _refusal(self, message: Mapping[str, Any]) -> InputError:
        """The error to raise if a worker does not answer a request."""
        if "error" in message:
            return InputError(message["error"])
        words = " ".join(self._command)
        return InputError(f"{words} does not answer as a worker does ({message}); is it Blender with this extension?")


def _threads(count: int) -> dict[str, str]:
    """Environment that gives each library one thread: the workers fill the cores, and sums are reproducible."""
    libraries = ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR")
    single = {f"{name}_NUM_THREADS": "1" for name in libraries}
    return {**single, "OPENIMAGEIO_THREADS": "1", THREADS_VARIABLE: str(count)}
