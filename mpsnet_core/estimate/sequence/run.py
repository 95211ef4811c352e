"""Run a sequence: read, estimate, smooth and write frames in order. An interrupted run can be continued."""

import contextlib
import logging
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, nullcontext
from contextvars import Context, copy_context
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.capture.capture import Capture
from mpsnet_core.defaults import MAX_SMOOTHING, Convention
from mpsnet_core.errors import Batch, GeometryError, InputError, NoObject, SettingsError
from mpsnet_core.estimate.sequence.source import Frame
from mpsnet_core.io.files import check_own, ensure_folder, remove_abandoned
from mpsnet_core.io.provenance import is_result, is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap, write_normals

# --- temporal denoising of normals, without lag: a mean over earlier and later frames that show the same --------------
# A bilateral filter in time (Tomasi and Manduchi 1998). Past and future have equal weights. A neighbouring frame counts
# at a pixel only if the photos are equal there within camera noise, over small patches as in non-local means (Buades et
# al. 2005). Moving objects keep their edges; static ones lose noise by the square root of the number of frames.


PATCH = 7  # side in pixels of the patches to compare
# The mean square difference of a patch, divided by the noise variance, is 1 without motion, with a standard deviation
# of sqrt(2 / (3 * 49)) = 0.12. Up to this value, the difference counts as noise.
SURE = 1.5
# Noise grows with brightness: it is measured in this many classes of brightness, on about this many pixels in all.
CLASSES = 8
MEASURED = 32768
# Lower limit of the noise, as a share of the light; it changes a normal by about one degree. Compressed video copies
# many pixels from frame to frame, whose differences show less noise than others. In shadows, the limit is for this
# share of the mean light.
MIN_NOISE = 0.01
SHADOW = 0.2
# Lower limit of confidence: if no frame is confident, all have equal weights.
MIN_CONFIDENCE = 0.01

# Median absolute value of unit normal noise, and the gain of Immerkær's kernel (1996) on noise.
MEDIAN_OF_NOISE = 0.6745
KERNEL_GAIN = 6.0


@dataclass(frozen=True)
class EstimatedFrame:
    """A frame of which the normals are estimated."""

    number: int
    """Frame number."""
    photo: Floats
    """(H, W, 3). Linear photo."""
    normals: NormalMap
    """Its estimated normals."""
    wanted: bool = True
    """Whether its smoothed normals are needed."""


def smoothed(frames: Iterable[EstimatedFrame], reach: int, step: int = 1) -> Iterator[tuple[int, NormalMap]]:
    """Number and smoothed normals of every wanted frame, in order, delayed by at most `reach` frames.

    frames: in increasing order of their numbers. reach: number of frames before and after a frame to average it with;
    fewer at the ends and where frames are missing. 0 does not smooth. step: least difference between the numbers of
    successive frames.

    Raises SettingsError if `reach` is out of range, GeometryError if two photos within it differ in size.
    """
    if not 0 <= reach <= MAX_SMOOTHING:
        raise SettingsError(f"smoothing over {reach} frames each way is out of range; choose 0 to {MAX_SMOOTHING}")
    span = reach * step
    recent: deque[EstimatedFrame] = deque()
    waiting: deque[EstimatedFrame] = deque()
    similarities: dict[tuple[int, int], F32] = {}
    for frame in frames:
        while waiting and waiting[0].number + span < frame.number:
            yield from _answer(waiting.popleft(), recent, similarities, span)
        while recent and recent[0].number < frame.number - 2 * span:
            gone = recent.popleft().number
            similarities = {pair: similarity for pair, similarity in similarities.items() if gone not in pair}
        for earlier in recent:
            if frame.number - earlier.number <= span and (frame.wanted or earlier.wanted):
                similarities[earlier.number, frame.number] = _similarity(earlier, frame)
        recent.append(frame)
        waiting.append(frame)
        while waiting and waiting[0].number + span <= frame.number:
            yield from _answer(waiting.popleft(), recent, similarities, span)
    for frame in waiting:
        yield from _answer(frame, recent, similarities, span)


def _answer(
    frame: EstimatedFrame, recent: Iterable[EstimatedFrame], similarities: dict[tuple[int, int], F32], span: int
) -> Iterator[tuple[int, NormalMap]]:
    if not frame.wanted:
        return
    near = [other for other in recent if abs(other.number - frame.number) <= span]
    if len(near) == 1:
        yield frame.number, frame.normals
        return
    total = np.zeros_like(frame.normals.vectors)
    for other in near:
        weight = other.normals.confidence + np.float32(MIN_CONFIDENCE)
        if other is not frame:
            weight = weight * similarities[min(frame.number, other.number), max(frame.number, other.number)]
        total += weight[..., None] * other.normals.vectors  # normals are zero outside their mask
    yield frame.number, NormalMap(total, frame.normals.mask, frame.normals.confidence)


def _similarity(a: EstimatedFrame, b: EstimatedFrame) -> F32:
    """(H, W) weights, 0 to 1, of how certainly two photos are equal around a pixel, up to noise; 0 outside a mask."""
    if a.photo.shape != b.photo.shape:
        sizes = " and ".join(f"{frame.photo.shape[1]} x {frame.photo.shape[0]}" for frame in (a, b))
        raise GeometryError(f"frames {a.number} and {b.number} are {sizes}; smoothing needs frames of one size")
    both = a.normals.mask & b.normals.mask
    squares = np.zeros(both.shape, np.float32)
    for channel in range(3):
        first, second = (frame.photo[..., channel].astype(np.float32, copy=False) for frame in (a, b))
        difference = np.where(both, second - first, np.float32(0))
        squares += np.square(difference / _noise(difference, (first + second) / np.float32(2), both))
    count = box_sums(both.astype(np.float32), PATCH // 2)
    mean_square = box_sums(squares, PATCH // 2) / np.maximum(3 * count, 1)
    return np.where(both, np.exp(-np.maximum(mean_square - SURE, 0)), 0).astype(np.float32)


def _noise(difference: F32, brightness: F32, inside: Bools) -> F32:
    """(H, W) standard deviation of the noise in a difference of photos, as a function of brightness.

    Immerkær's kernel removes constants and gradients from the difference. The remainder is noise, except along moving
    edges, which the median ignores.
    """
    across = difference[:, :-2] - 2 * difference[:, 1:-1] + difference[:, 2:]
    rest = np.abs(across[:-2] - 2 * across[1:-1] + across[2:]) / (KERNEL_GAIN * MEDIAN_OF_NOISE)
    whole = inside[:, :-2] & inside[:, 1:-1] & inside[:, 2:]
    places = np.flatnonzero(whole[:-2] & whole[1:-1] & whole[2:])
    places = places[:: max(1, len(places) // MEASURED)]
    mean = float(brightness.mean(where=inside)) if inside.any() else 0.0
    least = np.float32(MIN_NOISE) * np.maximum(brightness, np.float32(max(SHADOW * mean, 1e-6)))
    if len(places) < CLASSES:
        return least
    rest, level = rest.ravel()[places], brightness[1:-1, 1:-1].ravel()[places]
    classes = np.array_split(np.argsort(level, kind="stable"), CLASSES)
    levels = [float(level[members].mean()) for members in classes]
    strengths = [float(np.median(rest[members])) for members in classes]
    return np.maximum(np.interp(brightness, levels, strengths).astype(np.float32), least)


# Frames to read ahead, and normals that may wait to be written: just enough to keep both estimate and disk busy.
AHEAD = 2

T = TypeVar("T")

log = logging.getLogger(__name__)


@dataclass
class Outcome:
    """The result of a run."""

    made: int = 0
    """Number of normal maps written."""
    there: int = 0
    """Number of normal maps that existed and were up to date."""
    pixels: int = 0
    """Number of pixels inside the masks of those that were written."""
    left_out: list[int] = field(default_factory=list)
    """Numbers of the frames without an object, which have no normal map."""
    failed: dict[int, str] = field(default_factory=dict)
    """Why frames failed, by their numbers, although the others were made."""


def estimate_sequence(
    frames: Iterable[Frame],
    take: Callable[[Frame], Capture],
    estimator: Callable[[Capture, Progress], NormalMap],
    *,
    recipe: str,
    smooth: int = 0,
    step: int = 1,
    continue_on_error: bool = False,
    convention: Convention = "opengl",
    count: int = 0,
    progress: Progress = silent,
) -> Outcome:
    """Write the normals of every frame to its output, in order. Outputs that are up to date are skipped.

    Parameters
    ----------
    frames : iterable of Frame
        In increasing order of their numbers, with outputs in one folder, which is created if missing.
    take : callable
        Reads a frame as a capture. Called in a separate thread, one frame at a time.
    estimator : callable
        Returns the normals of a capture, for example :class:`mpsnet_core.estimate.estimator.Estimator`.
    recipe : str
        Text that changes with every other setting that the normals depend on. Each output stores a line made from it
        and `Frame.made_from`. A complete output with the same line is up to date.
    smooth : int
        Number of frames before and after a frame to average it with, see :func:`smoothed`.
    step : int
        Least difference between the numbers of successive frames.
    continue_on_error : bool
        Whether the frames are photos that are made although others fail. By default the first that fails ends the run:
        a video has to be read in order, and smoothing would average the frames near a failed one without it.
    convention : {"opengl", "directx"}
        Green up or green down.
    count : int
        Approximate number of frames, for `progress`; 0 if unknown.
    progress : callable
        Called with the share done, 0 to 1, and a message.

    Returns
    -------
    Outcome

    Raises
    ------
    InputError
        If a frame cannot be written, or none shows an object; if one cannot be read or estimated, or with
        `continue_on_error` the first few.
    Cancelled
        If `progress` raises it.

    Notes
    -----
    However it ends, all files are complete, and the same call continues from there. Memory does not grow with the
    number of frames. A frame without an object is left out with a warning. If other frames show one, its normal map
    from an earlier run is removed at the end.
    """
    recipe = f"{recipe}\nsmooth {smooth}\n{convention}"
    return _Run(take, estimator, recipe, continue_on_error, convention, count, progress).run(frames, smooth, step)


@dataclass
class _Run:
    """Arguments of :func:`estimate_sequence`, and its progress."""

    take: Callable[[Frame], Capture]
    """Reads a frame."""
    estimator: Callable[[Capture, Progress], NormalMap]
    """Estimates a frame's normals."""
    recipe: str
    """Text that changes with anything that the normals depend on, except the frames."""
    continue_on_error: bool
    """Whether other frames are estimated if one fails."""
    convention: Convention
    """Which way the green channel points."""
    count: int
    """Number of frames, 0 if unknown."""
    progress: Progress
    """Progress of the whole run."""
    outcome: Outcome = field(default_factory=Outcome)
    """The result so far."""
    batch: Batch[int] = field(default_factory=Batch)
    """The frames that were tried so far."""
    no_object: NoObject | None = None
    """Error of the first frame without an object."""
    stale: list[Path] = field(default_factory=list)
    """Outputs of such frames, which may exist from earlier runs."""
    unwritten: dict[int, Frame] = field(default_factory=dict)
    """Frames that were read and whose normals are not yet written, by number."""

    def run(self, frames: Iterable[Frame], smooth: int, step: int) -> Outcome:
        outcome = self.outcome
        steps = _plan(frames, self.recipe, smooth * step)
        try:
            with closing(_prefetch(self._captures(steps))) as captures, ThreadPoolExecutor(1, "mpsnet-write") as writer:
                writing: deque[Future[None]] = deque()
                for number, normals in smoothed(self._estimates(captures), smooth, step):
                    frame = self.unwritten.pop(number)
                    writing.append(writer.submit(copy_context().run, self._write, frame, normals))
                    while len(writing) > AHEAD:
                        writing.popleft().result()
                for written in writing:
                    written.result()
        except InputError as error:
            if not outcome.made:
                raise
            made = f"{outcome.made} frame{'s were' if outcome.made > 1 else ' was'} made"
            raise type(error)(f"{error}; {made}; run the same command again to continue") from None
        self.batch.check_any()
        if self.no_object is not None and not outcome.made + outcome.there:
            raise self.no_object  # the mask is wrong, for example: keep the normal maps of an earlier run
        outcome.failed = self.batch.failed()
        for output in self.stale:
            if output.is_file() and is_result(output, "normals"):
                with contextlib.suppress(OSError):  # files that cannot be removed stay
                    output.unlink()
        self.progress(1.0, "done")
        return outcome

    def _captures(self, steps: Iterable["_Step"]) -> Generator[tuple["_Step", Capture | InputError | None], None, None]:
        for step in steps:
            yield step, self._capture_of(step.frame) if step.needed else None

    def _capture_of(self, frame: Frame) -> Capture | InputError | None:
        """The frame as a capture, None if it shows no object, or why it cannot be taken."""
        try:
            return self.take(frame)
        except NoObject as error:
            self.no_object = self.no_object or error
            self.outcome.left_out.append(frame.number)
            self.stale.append(frame.output)
            log.warning("%s; this frame is left out", error)
            return None
        except InputError as error:
            return error

    def _estimates(self, captures: Iterable[tuple["_Step", Capture | InputError | None]]) -> Iterator[EstimatedFrame]:
        for number, (step, capture) in enumerate(captures):
            total = max(self.count, number + 1)
            share = part(self.progress, number / total, (number + 1) / total)
            name = str(step.frame.source)
            share(0.0, f"{number + 1} of {total}: {name}" if self.count else name)
            self.outcome.there += not step.stale
            self.batch.succeeded += not step.stale
            if capture is None:
                continue
            normals = None
            with self.batch.one(step.frame.number) if self.continue_on_error else nullcontext():
                if isinstance(capture, InputError):
                    raise capture
                normals = self.estimator(capture, part(share, 0.0, 0.9, name))
            if normals is None:
                continue
            if step.stale:
                self.unwritten[step.frame.number] = step.frame
            yield EstimatedFrame(step.frame.number, capture.image, normals, step.stale)

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
    """A frame and what is to do about it."""

    frame: Frame
    """The frame."""
    stale: bool
    """Whether to write its output."""
    needed: bool
    """Whether to read it, for its own output or for another's."""


def _plan(frames: Iterable[Frame], recipe: str, span: int) -> Iterator[_Step]:
    """What to do with each frame, delayed by `span` numbers, because a later output may need it.

    First removes unfinished files of killed runs from their folder.
    """
    waiting: deque[_Step] = deque()
    last_stale: int | None = None
    for place, frame in enumerate(frames):
        if place == 0:
            remove_abandoned(frame.output.parent)
        while waiting and waiting[0].frame.number < frame.number - span:
            yield waiting.popleft()
        stale = not is_up_to_date(frame.output, _line(frame, recipe))
        if stale:
            check_own(frame.output)
            last_stale = frame.number
            for step in waiting:
                step.needed = True
        needed = last_stale is not None and frame.number - last_stale <= span
        waiting.append(_Step(frame, stale, needed))
    yield from waiting


# --- threads ----------------------------------------------------------------------------------------------------------


def _prefetch(items: Generator[T, None, None]) -> Generator[T, None, None]:
    """The items, computed in a thread up to AHEAD in advance. Exceptions are raised when the item's turn comes."""
    end = object()

    def advance(context: Context) -> object:
        return context.run(lambda: next(items, end))

    reader = ThreadPoolExecutor(1, "mpsnet-read")
    pending: deque[Future[object]] = deque()
    try:
        while True:
            while len(pending) <= AHEAD:
                pending.append(reader.submit(advance, copy_context()))
            item = pending.popleft().result()
            if item is end:
                return
            yield item  # type: ignore[misc]
            del item
    finally:
        reader.shutdown(cancel_futures=True)
        items.close()
