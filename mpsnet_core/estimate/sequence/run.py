"""A sequence's run: frames are read, estimated, smoothed and written in order, and one that was cut short goes on."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import TypeVar

from mpsnet_core.capture.capture import Capture, note_doubts
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.sequence.smoothing import Shot, smoothed
from mpsnet_core.estimate.sequence.source import Frame
from mpsnet_core.io.files import ensure_folder, remove_abandoned
from mpsnet_core.io.provenance import is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import Convention, NormalMap, write_normals

# Frames that are read before their turn, and normals that wait to be written: enough that neither the estimate nor a
# disk waits for the other, and no more memory than that.
AHEAD = 2

T = TypeVar("T")


@dataclass
class Outcome:
    """What a run brought. made: normal maps written by it. there: those that were there already. pixels: of those that
    were made, inside their masks."""

    made: int = 0
    there: int = 0
    pixels: int = 0


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
    """Write the normals of every frame to its output, in order; those that are there already are left as they are.

    frames: by rising number, all with outputs in one folder, which is made where it is missing.
    take: reads a frame as a capture; called in a thread of its own, for one frame after the other.
    recipe: text that changes with every other setting that the normals depend on. Each output keeps a line that tells
        recipe and `Frame.made_from`; one that is whole and says the same as what would be written counts as there.
    smooth: how many frames before and behind count for a frame's normals, `step` by which their numbers rise at least;
        see `smoothing`.
    count: how many frames there are about, for `progress`; 0 where that is not known.

    However it ends, what it wrote is whole, and the same call goes on from there. Memory does not grow with the number
    of frames.

    Raises InputError where a frame cannot be read, estimated or written; Cancelled where `progress` does.
    """
    outcome = Outcome()
    recipe = f"{recipe}\nsmooth {smooth}\n{convention}"
    pending: dict[int, Frame] = {}

    def captured() -> Generator[tuple[_Step, Capture | None], None, None]:
        for todo in _plan(_cleared(frames), recipe, smooth * step):
            yield todo, take(todo.frame) if todo.needed else None

    def estimated(captures: Iterable[tuple[_Step, Capture | None]]) -> Iterator[Shot]:
        noted = False
        for number, (todo, capture) in enumerate(captures):
            total = max(count, number + 1)
            tell = part(progress, number / total, (number + 1) / total)
            tell(0.0, f"{todo.frame.name} of {total}" if count else todo.frame.name)
            outcome.there += not todo.stale
            if capture is None:
                continue
            if not noted:  # of the first frame: the others are much like it
                note_doubts(capture)
                noted = True
            normals = estimator(capture, part(tell, 0.0, 0.9, todo.frame.name))
            if todo.stale:
                pending[todo.frame.number] = todo.frame
            yield Shot(todo.frame.number, capture.image, normals, todo.stale)

    def write(frame: Frame, normals: NormalMap) -> None:
        if not outcome.made:
            ensure_folder(frame.output.parent, "normals")
        write_normals(frame.output, normals, convention=convention, description=_line(frame, recipe))
        outcome.made += 1
        outcome.pixels += int(normals.mask.sum())

    try:
        with closing(_ahead(captured())) as captures, _Behind() as writer:
            for number, normals in smoothed(estimated(captures), smooth, step):
                writer.run(write, pending.pop(number), normals)
    except InputError as error:
        if not outcome.made:
            raise
        made = f"{outcome.made} frame{'s were' if outcome.made > 1 else ' was'} made"
        raise InputError(f"{error}; {made}, and the same command goes on from there") from None
    progress(1.0, "done")
    return outcome


def _line(frame: Frame, recipe: str) -> str:
    return provenance_line("normals", f"{recipe}\n\n{frame.mask_identity}")


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
    """What is to be done with each frame, told `span` numbers late: a later output may need it."""
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
    """The items, made in a thread up to AHEAD before they are asked for; what fails there is raised in its turn."""
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

    def run(self, work: Callable[..., None], *given: object) -> None:
        """Do `work` later; raises what earlier work raised."""
        self._pending.append(self._worker.submit(work, *given))
        while len(self._pending) > AHEAD:
            self._pending.popleft().result()

    def __enter__(self) -> "_Behind":
        return self

    def __exit__(self, *error: object) -> None:
        self._worker.shutdown()
        if error[0] is None:
            for work in self._pending:
                work.result()
