"""How long work tells how far it is, and learns that it shall stop."""

from collections.abc import Callable

# Called with the fraction done (0 to 1) and what is being done; it raises Cancelled when the person asked to stop.
Progress = Callable[[float, str], None]


def silent(fraction: float, message: str) -> None:
    """Progress that nobody watches."""


def part(progress: Progress, start: float, end: float, told: str | None = None) -> Progress:
    """The stretch from `start` to `end` of a longer work's progress, which always says `told` where that is given."""
    return lambda fraction, message: progress(start + (end - start) * fraction, message if told is None else told)
