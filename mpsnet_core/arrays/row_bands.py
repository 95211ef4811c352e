"""Bands of rows, which keep intermediate arrays small for images of any size, and parallelise the work."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Job = TypeVar("Job")

# A multiple of the rows that TIFF and EXR files compress together.
ROWS = 256
# For several intermediate arrays with three channels: memory allocators keep what large ones have taken.
FEW_ROWS = 64


def bands(height: int, rows: int = ROWS) -> list[slice]:
    """Slices of `rows` rows that cover an image of `height` rows from top to bottom; also blocks of other items."""
    return [slice(top, min(top + rows, height)) for top in range(0, height, rows)]


def on_all_cores(work: Callable[[Job], None], jobs: Iterable[Job], after: Callable[[], None] = lambda: None) -> None:
    """Do `work` for every job in threads, and call `after` in this thread once per job. An exception ends all of it."""
    jobs = list(jobs)
    with ThreadPoolExecutor(usable_cores()) as pool:
        # The one band of a small image is done in this thread.
        apply = pool.map if len(jobs) > 1 else map
        try:
            for _ in apply(work, jobs):
                after()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def usable_cores() -> int:
    """Number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
