"""Progress reports of long work, and its cancellation."""

from collections.abc import Callable

# Called with the fraction done (0 to 1) and what is being done; it raises Cancelled to stop the work.
Progress = Callable[[float, str], None]


def silent(fraction: float, message: str) -> None:
    """Progress that is not shown."""


def part(progress: Progress, start: float, end: float, label: str | None = None) -> Progress:
    """Progress of a step, from `start` to `end` of the whole; `label` replaces the step's own messages."""
    return lambda fraction, message: progress(start + (end - start) * fraction, message if label is None else label)
