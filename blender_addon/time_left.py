"""How long work will still take, from how far it came in how long."""

from dataclasses import dataclass

# Before so much is done, in at least so long, a guess would be worth nothing and is not made. In longer work it is made
# after less of it.
_LEAST_SHARE, _LEAST_SECONDS = 0.03, 2.0
_LEAST_SHARE_LATER, _LATER_SECONDS = 0.005, 20.0


@dataclass
class Pace:
    """The pace of one run. What comes before its first progress, the start of a process, does not count.

    Times are in seconds by a clock that does not go back.
    """

    _begun: tuple[float, float] | None = None
    _last: float = 0.0

    def left(self, now: float, done: float) -> float | None:
        """Seconds left at the time `now` with the fraction `done` (0 to 1), None where that cannot be known yet.

        Ask at every progress: the first one above 0 is where the pace is measured from. While nothing moves on the
        time left grows; where `done` falls back, another part of the work begins, and its pace is measured anew.
        """
        if done <= 0:
            return None
        if self._begun is None or done < self._last:
            self._begun = now, done
        self._last = done
        since, share = now - self._begun[0], done - self._begun[1]
        if since < _LEAST_SECONDS or share < (_LEAST_SHARE if since < _LATER_SECONDS else _LEAST_SHARE_LATER):
            return None
        return since * (1 - done) / share


def in_words(seconds: float | None) -> str:
    """ "40 s left", "3 min left", "2 h 10 min left"; "" for None. Rounded as guesses are, and never to nothing."""
    if seconds is None:
        return ""
    if seconds <= 55:
        return f"{max(5, 5 * round(seconds / 5))} s left"
    minutes = max(1, round(seconds / 60))
    if minutes < 60:
        return f"{minutes} min left"
    hours, minutes = divmod(10 * round(minutes / 10), 60)
    return f"{hours} h {minutes} min left" if minutes else f"{hours} h left"
