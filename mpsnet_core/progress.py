"""Progress reports and cancellation of long tasks."""

import sys
import threading
import time
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any, TypeVar

# Called with the fraction done (0 to 1) and the current activity. It raises Cancelled to stop the work.
Progress = Callable[[float, str], None]

# A remaining time is told once this much is done, and that many seconds have passed.
TOLD_FROM, TOLD_AFTER = 0.03, 3.0


def silent(fraction: float, message: str) -> None:
    """Ignore progress."""


def part(progress: Progress, start: float, end: float, label: str | None = None) -> Progress:
    """Progress of a step that takes the total from `start` to `end`. `label` replaces the step's own messages."""
    return lambda fraction, message: progress(start + (end - start) * fraction, message if label is None else label)


def remaining_words(fraction: float, seconds: float) -> str:
    """How long a task has taken, and about how long it still will if it goes on as it went so far."""
    told = f"{duration(seconds)} so far"
    if not TOLD_FROM <= fraction < 1 or seconds < TOLD_AFTER:
        return told
    return f"{told}, about {duration(seconds * (1 - fraction) / fraction)} left"


def duration(seconds: float) -> str:
    """A duration as short text: "40 s", "12 min 5 s", "3 h 20 min"."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


class Bar:
    """A progress bar on stderr, in a terminal or a notebook, which tells the time anew every second."""

    def __init__(self) -> None:
        from tqdm import tqdm

        layout = "{percentage:3.0f}%|{bar:20}| {desc}"
        self._bar: Any = tqdm(total=100, bar_format=layout, leave=False, dynamic_ncols=True)
        self._started, self._fraction, self._message = time.monotonic(), 0.0, ""
        self._closed = threading.Event()
        threading.Thread(target=self._tick, daemon=True).start()

    def __call__(self, fraction: float, message: str) -> None:
        self._fraction, self._message = fraction, message
        self._bar.n = round(100 * fraction)
        self._show()

    def close(self) -> None:
        """Remove the bar."""
        self._closed.set()
        self._bar.close()

    def _tick(self) -> None:
        while not self._closed.wait(1.0):
            self._show()

    def _show(self) -> None:
        words = remaining_words(self._fraction, time.monotonic() - self._started)
        # A narrow terminal cuts the end off.
        self._bar.set_description_str(f"{words}: {self._message}", refresh=not self._closed.is_set())


def can_show_bar() -> bool:
    """Whether somebody watches stderr: a terminal, or a notebook."""
    return "ipykernel" in sys.modules or bool(sys.stderr and sys.stderr.isatty())


class Lines:
    """A line on stderr for each activity, where a bar would fill a log."""

    def __init__(self) -> None:
        self._told = ""

    def __call__(self, fraction: float, message: str) -> None:
        if message != self._told:
            self._told = message
            sys.stderr.write(f"{message}\n")
            sys.stderr.flush()

    def close(self) -> None:
        """Do nothing."""


def shown_progress() -> Bar | Lines:
    """A bar where somebody watches, else lines."""
    return Bar() if can_show_bar() else Lines()


# --- functions that signals must not interrupt, such as those that clean up -------------------------------------------


Function = TypeVar("Function", bound=Callable[..., object])

_CODES: set[CodeType] = set()


def uninterrupted(function: Function) -> Function:
    """Mark a Python function, which must be quick: a signal handler that asks :func:`is_uninterrupted` waits for it."""
    _CODES.add(function.__code__)
    return function


def is_uninterrupted(frame: FrameType) -> bool:
    """Whether a frame runs a function that is marked. Its callers are other frames."""
    return frame.f_code in _CODES
