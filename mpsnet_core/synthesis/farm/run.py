"""The farm: make a job's samples by many workers, on this machine or on a Dask cluster."""

import itertools
import logging
import shutil
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from mpsnet_core.arrays.row_bands import usable_cores
from mpsnet_core.errors import InputError, SettingsError
from mpsnet_core.io.claims import Claims
from mpsnet_core.io.files import check_no_link, resolved, writable_path
from mpsnet_core.io.image_writing import is_complete_image, write_picture
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import is_up_to_date
from mpsnet_core.progress import Progress, duration, silent
from mpsnet_core.synthesis import job as jobs
from mpsnet_core.synthesis.contact_sheet import sheet_line, sheet_of_samples
from mpsnet_core.synthesis.farm.work import THIS_PYTHON, SampleResult, SampleResults, Worker, clear_unfinished, gathered

log = logging.getLogger(__name__)

SYNTHESIS_COMMAND = (THIS_PYTHON, "-m", "mpsnet_core", "work")
# After this many consecutive failures, stop: the rest would fail, too.
FAILURES_IN_A_ROW = 20

SHEET_SECONDS = 5.0
# Largest share of the time to spend on updating the contact sheet.
SHEET_SHARE = 0.05


@dataclass
class JobOutcome:
    """The result of a run."""

    made: int = 0
    """Number of samples it made."""
    there: int = 0
    """Number of samples that existed, or were made by another run."""
    failed: dict[int, str] = field(default_factory=dict)
    """Error sentences by sample number."""


def blender_command(blender: str = "", addon: str = "") -> tuple[str, ...]:
    """Command of a rendering worker: the Blender program `blender`, by default this Python's bpy.

    addon: module of the extension in that Blender, to enable it if the saved preferences do not.
    """
    if blender:
        found = shutil.which(blender)
        here = found and Path(blender).name == blender and Path(found).parent.resolve() == Path.cwd().resolve()
        if here:  # Windows searches the current folder
            raise SettingsError(f"{blender} is in this folder, which may hold files of others; give its path in full")
        return blender, "-b", *(("--addons", addon) if addon else ()), "--command", "mpsnet", "work"
    return THIS_PYTHON, "-m", "blender_addon", "work"


def make_samples(
    folder: AnyPath,
    job: jobs.SampleJob,
    command: Sequence[str] = SYNTHESIS_COMMAND,
    *,
    processes: int = 0,
    cluster: str = "",
    cluster_trusted: bool = False,
    progress: Progress = silent,
) -> JobOutcome:
    """Make the samples of `job` that are missing in `folder`, and update its contact sheet.

    command: of a worker (:mod:`mpsnet_core.synthesis.farm.work`). processes: workers on this machine, 0 for one per
    core. cluster: address of a Dask scheduler whose workers do it instead; they must reach the folder by the same path.
    cluster_trusted: allow a remote address without TLS, because the whole network is trusted; a server that answers
    there can run any code here.

    However it ends, existing samples are complete, and the same call continues. Several runs can share a folder, and
    share the work.

    Raises InputError if the folder has another job, no worker can be started, 20 consecutive samples cannot be made, or
    the cluster cannot be used.
    """
    folder = resolved(folder)
    if cluster:
        from mpsnet_core.synthesis.farm.address import check_address
        from mpsnet_core.synthesis.farm.cluster import results_from_cluster

        check_address(cluster, trusted=cluster_trusted)  # before a folder is made
    is_new = jobs.place_job(folder, job)
    writable_path(folder / jobs.CONTACT_SHEET)
    clear_unfinished(folder)
    there = _complete_samples(folder, progress)
    numbers = [number for number in range(job.count) if number not in there]
    tally = _Tally(job.count, job.count - len(numbers), progress)
    sheet = _GrowingSheet(folder)
    if cluster:
        results = results_from_cluster(cluster, command, folder, numbers, trusted=cluster_trusted)
    else:
        results = _results_from_processes(command, folder, numbers, processes or usable_cores())
    try:
        tally.report()
        with closing(results):
            for result in results:
                if result is not None:
                    tally.add(result)
                tally.report()
                sheet.grow(tally.outcome.made)
    except InputError:
        if is_new:
            jobs.withdraw_job(folder)
        raise
    finally:
        clear_unfinished(folder)
    sheet.draw()
    return tally.outcome


def _complete_samples(folder: Path, progress: Progress) -> set[int]:
    there = sorted(jobs.samples_there(folder))
    whole = set()
    for place, number in enumerate(there):
        progress(0.0, f"looking through what is there, {place} of {len(there)}")
        if is_complete_image(jobs.sample_path(folder, number)):
            whole.add(number)
    return whole


# --- this machine -----------------------------------------------------------------------------------------------------


def _results_from_processes(
    command: Sequence[str], folder: Path, numbers: Sequence[int], processes: int
) -> SampleResults:
    processes = min(processes, len(numbers))
    if not processes:
        return
    job = jobs.read_job(folder)
    # Consecutive samples with the same shape go to one worker, which builds it once. Limit their number to balance the
    # load at the end.
    longest = max(1, len(numbers) // (4 * processes))
    batches = itertools.groupby(numbers, lambda number: (number // job.views, number % job.views // longest))
    threads_each = max(1, usable_cores() // processes)
    workers = [Worker(command, folder, threads_each, seconds=job.sample_seconds) for _ in range(processes)]
    own, spare = threading.local(), list(workers)

    def make(batch: Sequence[int]) -> list[SampleResult]:
        return [own.worker.make(number) for number in batch]

    with ThreadPoolExecutor(processes, initializer=lambda: setattr(own, "worker", spare.pop())) as pool:
        try:
            tasks = [tuple(batch) for _, batch in batches]
            yield from gathered(lambda batch: pool.submit(make, batch), tasks, lambda task, _: task.result(), {})
            list(pool.map(Worker.close, workers))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.end()


# --- what is reported on the way --------------------------------------------------------------------------------------


class _Tally:
    """Counts answers and reports progress."""

    def __init__(self, count: int, there: int, progress: Progress) -> None:
        self.outcome = JobOutcome(there=there)
        self._count, self._progress = count, progress
        self._start, self._before = time.monotonic(), there
        self._failures_in_a_row = 0

    def add(self, result: SampleResult) -> None:
        """Count an answer. Raises InputError after too many consecutive failures."""
        if result.state == "failed":
            self.outcome.failed[result.number] = result.error
            self._failures_in_a_row += 1
            if self._failures_in_a_row == FAILURES_IN_A_ROW:
                raise InputError(
                    f"stopped: {FAILURES_IN_A_ROW} samples in a row failed, the last because {result.error}"
                )
            return
        self._failures_in_a_row = 0
        if result.state == "made":
            self.outcome.made += 1
        else:
            self.outcome.there += 1

    def report(self) -> None:
        done = self.outcome.made + self.outcome.there + len(self.outcome.failed)
        message = f"{done} of {self._count}"
        if self._before < done < self._count:
            seconds = (time.monotonic() - self._start) / (done - self._before) * (self._count - done)
            message += f", {duration(seconds)} left"
        if self.outcome.failed:
            message += f", {len(self.outcome.failed)} failed"
        self._progress(done / self._count, message)


class _GrowingSheet:
    """The folder's contact sheet, redrawn from time to time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._shown, self._next = 0, 0.0

    def grow(self, made: int) -> None:
        """Redraw it if there are new samples and enough time has passed."""
        if made > self._shown and time.monotonic() >= self._next:
            start = time.monotonic()
            self._shown = made
            self.draw()
            now = time.monotonic()
            self._next = now + max(SHEET_SECONDS, (now - start) / SHEET_SHARE)

    def draw(self) -> None:
        """Redraw it if it is out of date, no matter who made the samples."""
        try:
            self._write()
        except InputError as error:  # a viewer that has the file open must not end the run
            log.info("the contact sheet is not up to date: %s", error)

    def _write(self) -> None:
        files = [jobs.sample_path(self._folder, number) for number in sorted(jobs.samples_there(self._folder))]
        line = sheet_line(files)  # computed before reading: a sample that changes meanwhile makes the sheet out of date
        if is_up_to_date(self._folder / jobs.CONTACT_SHEET, line):
            return
        picture = sheet_of_samples(files)
        if picture is None:
            return
        with Claims(self._folder) as claims, claims.claim(jobs.FOLDER_CLAIM) as ours:
            if ours:  # else another run is writing the same sheet
                check_no_link(self._folder / jobs.CONTACT_SHEET)
                write_picture(self._folder / jobs.CONTACT_SHEET, picture, description=line)
