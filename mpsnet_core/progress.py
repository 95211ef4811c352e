"""Progress reports and cancellation of long tasks."""

from collections.abc import Callable

# Called with the fraction done (0 to 1) and the current activity. It raises Cancelled to stop the work.
Progress = Callable[[float, str], None]


def silent(fraction: float, message: str) -> None:
    """Ignore progress."""


def part(progress: Progress, start: float, end: float, label: str | None = None) -> Progress:
    """Progress of a step that takes the total from `start` to `end`. `label` replaces the step's own messages."""
    return lambda fraction, message: progress(start + (end - start) * fraction, message if label is None else label)
