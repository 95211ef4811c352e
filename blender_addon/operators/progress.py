"""Progress in the panel, at the mouse pointer and in the log, with an estimate of the time left."""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mpsnet_core.errors import Note
from mpsnet_core.progress import Progress

LOG_SECONDS = 10.0

# The time left is estimated after this fraction and this many seconds; before, the estimate would be worthless. In
# longer work, a smaller fraction suffices.
_MIN_SHARE, _MIN_SECONDS = 0.03, 2.0
_MIN_SHARE_LATER, _LATER_SECONDS = 0.005, 20.0

log = logging.getLogger(__name__)

# Told of the progress of every script's work.
listeners: list[Progress] = []


@contextmanager
def cursor_progress(manager: Any) -> Iterator[Progress]:
    """Progress of a script's work: at the mouse pointer, and occasionally as a line in the log."""
    logged = time.monotonic()

    def show(done: float, message: str) -> None:
        nonlocal logged
        manager.progress_update(int(100 * done))
        for listener in listeners:
            listener(done, message)
        if time.monotonic() - logged >= LOG_SECONDS:
            log.info("%.0f%%: %s", 100 * done, message)
            logged = time.monotonic()

    manager.progress_begin(0, 100)
    try:
        yield show
    finally:
        manager.progress_end()


def redraw_panels(manager: Any) -> None:
    """Redraw the sidebars of all 3D viewports, but not the viewports, which may take seconds."""
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


@dataclass
class Pace:
    """The speed of one run. The time before its first progress, in which a process starts, does not count.

    Times are in seconds of a monotonic clock.
    """

    _begun: tuple[float, float] | None = None
    """Time and fraction done of the first progress; None before it."""
    _last: float = 0.0
    """The fraction done at the last progress."""

    def left(self, now: float, done: float) -> float | None:
        """Seconds left at the time `now` with the fraction `done` (0 to 1), None if that is not yet known.

        Call it at every progress: the speed is measured from the first one above 0. The time left grows while nothing
        advances. If `done` decreases, another part of the work has started, and its speed is measured anew.
        """
        if done <= 0:
            return None
        if self._begun is None or done < self._last:
            self._begun = now, done
        self._last = done
        since, share = now - self._begun[0], done - self._begun[1]
        if since < _MIN_SECONDS or share < (_MIN_SHARE if since < _LATER_SECONDS else _MIN_SHARE_LATER):
            return None
        return since * (1 - done) / share


def time_left_text(seconds: float | None) -> str:
    """ "40 s left", "3 min left", "2 h 10 min left"; "" for None. Rounded like an estimate, never to zero."""
    if seconds is None:
        return ""
    if seconds <= 55:
        return Note("%d s left", max(5, 5 * round(seconds / 5)))
    minutes = max(1, round(seconds / 60))
    if minutes < 60:
        return Note("%d min left", minutes)
    hours, minutes = divmod(10 * round(minutes / 10), 60)
    return Note("%d h %d min left", hours, minutes) if minutes else Note("%d h left", hours)
