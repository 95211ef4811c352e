"""A sequence's run: frames are read, estimated, smoothed and written in order; one that was cut short continues."""

import contextlib
import logging
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from mpsnet_core.capture.capture import Capture, note_doubts
from mpsnet_core.errors import InputError, NoObject
from mpsnet_core.estimate.sequence.smoothing import Shot, smoothed
from mpsnet_core.estimate.sequence.source import Frame
from mpsnet_core.io.files import ensure_folder, remove_abandoned
from mpsnet_core.io.provenance import is_result, is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import Convention, NormalMap, write_normals

# Frames that are read before their turn, and normals that wait to be written: enough that neither the estimate nor a
# disk waits for the other, and no more memory than that.
AHEAD = 2

T = TypeVar("T")

log = logging.getLogger(__name__)


@dataclass
class Outcome:
    """The result of a run.

    Attributes
    ----------
    made
        How many normal maps it wrote.
    there
        How many existed before and were up to date.
    pixels
        Of those that were made, inside their masks.
    left_out
        Numbers of the frames that show no object, which have no normal map.
    """

    made: int = 0
    there: int = 0
    pixels: int = 0
    left_out: list[int] = field(default_factory=list)


def estimate_sequence(
    frames: Iterable[Frame],
    take: Callable[[Frame], Capture],
    estimator: Callable[[Capture, Progress], NormalMap],
    *,
    recipe: str,
    smooth: int = 0,
    step: int = 1,
    convention: Convention = "opengl",
    count: int = 0,
    progress: Progress = silent,
) -> Outcome:
    """Write the normals of every frame to its output, in order; those that are up to date are left as they are.

    Parameters
    ----------
    frames : iterable of Frame
        By rising number, all with outputs in one folder, which is made where it is missing.
    take : callable
        Reads a frame as a capture; called in a thread of its own, for one frame after the other.
    estimator : callable
        Returns the normals of a capture, :class:`mpsnet_core.estimate.estimator.Estimator` for instance.
    recipe : str
        Text that changes with every other setting that the normals depend on. Each output stores a line made of it and
        `Frame.made_from`; an output that is whole and has the same line is up to date.
    smooth : int
        How many frames before and behind count for a frame's normals, see :func:`smoothed`.
    step : int
        By how much the numbers of successive frames rise at least.
    convention : {"opengl", "directx"}
        Green up or green down.
    count : int
        How many frames there are about, for `progress`; 0 where unknown.
    progress : callable
        Receives the share that is done, 0 to 1, and what is being done.

    Returns
    -------
    Outcome

    Raises
    ------
    InputError
        Where a frame cannot be read, estimated or written, or none shows an object.
    Cancelled
        Where `progress` raises it.

    Notes
    -----
    However it ends, what it wrote is whole, and the same call continues from there. Memory does not grow with the
    number of frames. A frame that shows no object is left out with a warning. A normal map that it had from an earlier
    run is removed at the end, where other frames show one.
    """
    run = _Run(take, estimator, f"{recipe}\nsmooth {smooth}\n{convention}", convention, count, progress)
    return run.through(frames, smooth, step)


@dataclass
class _Run:
    """What :func:`estimate_sequence` was called with, and how far it is."""

    take: Callable[[Frame], Capture]
    estimator: Callable[[Capture, Progress], NormalMap]
    recipe: str
    convention: Convention
    count: int
    progress: Progress
    outcome: Outcome = field(default_factory=Outcome)
    nothing: NoObject | None = None  # of the first frame without an object
    stale: list[Path] = field(default_factory=list)  # where normal maps of such frames may be from before
    unwritten: dict[int, Frame] = field(default_factory=dict)

    def through(self, frames: Iterable[Frame], smooth: int, step: int) -> Outcome:
        outcome = self.outcome
        steps = _plan(_cleared(frames), self.recipe, smooth * step)
        try:
            with closing(_ahead(self._captured(steps))) as captures, _Behind() as writer:
                for number, normals in smoothed(self._estimated(captures), smooth, step):
                    writer.run(self._write, self.unwritten.pop(number), normals)
        except InputError as error:
            if not outcome.made:
                raise
            made = f"{outcome.made} frame{'s were' if outcome.made > 1 else ' was'} made"
            raise type(error)(f"{error}; {made}, and the same command goes on from there") from None
        if self.nothing is not None and not outcome.made + outcome.there:
            raise self.nothing  # as under a wrong mask, which must not cost the normal maps of an earlier run
        for output in self.stale:
            if output.is_file() and is_result(output, "normals"):
                with contextlib.suppress(OSError):  # what cannot be removed
                    output.unlink()
        self.progress(1.0, "done")
        return outcome

    def _captured(self, steps: Iterable["_Step"]) -> Generator[tuple["_Step", Capture | None], None, None]:
        for todo in steps:
            yield todo, self._taken(todo.frame) if todo.needed else None

    def _taken(self, frame: Frame) -> Capture | None:
        """The frame as a capture, None where it shows no object."""
        try:
            return self.take(frame)
        except NoObject as error:
            self.nothing = self.nothing or error
            self.outcome.left_out.append(frame.number)
            self.stale.append(frame.output)
            log.warning("%s; this frame is left out", error)
            return None

    def _estimated(self, captures: Iterable[tuple["_Step", Capture | None]]) -> Iterator[Shot]:
        noted = False
        for number, (todo, capture) in enumerate(captures):
            total = max(self.count, number + 1)
            share = part(self.progress, number / total, (number + 1) / total)
            share(0.0, f"{number + 1} of {total}: {todo.frame.name}" if self.count else todo.frame.name)
            self.outcome.there += not todo.stale
            if capture is None:
                continue
            if not noted:  # of the first frame: the others are much like it
                note_doubts(capture)
                noted = True
            normals = self.estimator(capture, part(share, 0.0, 0.9, todo.frame.name))
            if todo.stale:
                self.unwritten[todo.frame.number] = todo.frame
            yield Shot(todo.frame.number, capture.image, normals, todo.stale)

    def _write(self, frame: Frame, normals: NormalMap) -> None:
        if not self.outcome.made:
            ensure_folder(frame.output.parent, "normals")
        write_normals(frame.output, normals, convention=self.convention, description=_line(frame, self.recipe))
        self.outcome.made += 1
        self.outcome.pixels += int(normals.mask.sum())


def _line(frame: Frame, recipe: str) -> str:
    return provenance_line("normals", recipe, frame.made_from)


# --- what is to be done -----------------------------------------------------------------------------------------------


@dataclass
class _Step:
    """A frame, whether its output is to be written, and whether it must be read for its own output or another's."""

    frame: Frame
    stale: bool
    needed: bool


def _cleared(frames: Iterable[Frame]) -> Iterator[Frame]:
    """The frames; before the first, what a run that was killed left half-written in their folder is removed."""
    for number, frame in enumerate(frames):
        if number == 0:
            remove_abandoned(frame.output.parent)
        yield frame


def _plan(frames: Iterable[Frame], recipe: str, span: int) -> Iterator[_Step]:
    """What is to be done with each frame, `span` numbers late: a later output may need it."""
    waiting: deque[_Step] = deque()
    last_stale: int | None = None
    for frame in frames:
        while waiting and waiting[0].frame.number < frame.number - span:
            yield waiting.popleft()
        stale = not is_up_to_date(frame.output, _line(frame, recipe))
        if stale:
            last_stale = frame.number
            for step in waiting:
                step.needed = True
        needed = last_stale is not None and frame.number - last_stale <= span
        waiting.append(_Step(frame, stale, needed))
    yield from waiting


# --- threads ----------------------------------------------------------------------------------------------------------


def _ahead(items: Generator[T, None, None]) -> Generator[T, None, None]:
    """The items, made in a thread up to AHEAD before their turn; what fails there is raised in its turn."""
    end = object()
    reader = ThreadPoolExecutor(1, "mpsnet-read")
    pending: deque[Future[object]] = deque()
    try:
        while True:
            while len(pending) <= AHEAD:
                pending.append(reader.submit(next, items, end))
            item = pending.popleft().result()
            if item is end:
                return
            yield item  # type: ignore[misc]
            del item
    finally:
        reader.shutdown(cancel_futures=True)
        items.close()


class _Behind:
    """Work done in a thread in the order it was given, at most AHEAD waiting; on leaving, all of it has been done."""

    def __init__(self) -> None:
        self._worker = ThreadPoolExecutor(1, "mpsnet-write")
        self._pending: deque[Future[None]] = deque()

    def run(self, work: Callable[..., None], *arguments: object) -> None:
        """Do `work` later; raises what earlier work raised."""
        self._pending.append(self._worker.submit(work, *arguments))
        while len(self._pending) > AHEAD:
            self._pending.popleft().result()

    def __enter__(self) -> "_Behind":
        return self

    def __exit__(self, *error: object) -> None:
        self._worker.shutdown()
        if error[0] is None:
            for work in self._pending:
                work.result()
