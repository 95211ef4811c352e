"""Progress and notes of the command line."""

import contextlib
import itertools
import json
import logging
import os
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from mpsnet_core.errors import Note, NoteLevel, SettingsError, in_one_line
from mpsnet_core.progress import Bar, can_show_bar

_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
_OF_NOTES: dict[int, NoteLevel] = {logging.INFO: "good", logging.WARNING: "look", logging.ERROR: "stop"}


def log_level() -> int:
    """The level of the notes to show, by the environment variable MPSNET_LOG_LEVEL; all by default.

    Raises SettingsError if it is unknown.
    """
    name = os.environ.get("MPSNET_LOG_LEVEL") or "info"
    if name.lower() not in _LEVELS:
        raise SettingsError(f"MPSNET_LOG_LEVEL is {name!r}; set it to {', '.join(_LEVELS)}, or to nothing")
    return _LEVELS[name.lower()]


class NoteCollector(logging.Handler):
    """Collects the core's notes, to be shown once the work is done."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.notes: list[Note] = []

    def emit(self, record: logging.LogRecord) -> None:
        said = record.msg if isinstance(record.msg, Note) else Note(str(record.msg), *(record.args or ()))
        note = Note(said.template, *said.values, level=_OF_NOTES[record.levelno])
        if note not in self.notes:
            self.notes.append(note)

    def added_to(self, result: dict[str, Any]) -> dict[str, Any]:
        """The facts of a result with the notes: "notes" as sentences, "told" with levels and codes, for programs."""
        told = [*result.get("told", ()), *(note.facts() for note in self.notes)]
        return {**result, "notes": self.notes, "told": told}


class Reporter:
    """Reports progress: as a bar on stderr, as one JSON object per line on stdout, or not at all."""

    def __init__(self, style: str) -> None:
        if style == "auto":
            style = "bar" if can_show_bar() else "none"
        self.style, self.shown, self.when = style, -1.0, 0.0
        self.bar: Bar | None = None

    def progress(self, fraction: float, message: str) -> None:
        if self.style == "json":
            # Steps below half a percent do not change a progress bar; they are sent once a second for their message.
            now = time.monotonic()
            stepped = 1 <= fraction != self.shown or fraction - self.shown >= 0.005 or fraction < self.shown
            if stepped or (fraction > self.shown and now - self.when >= 1):
                self.shown, self.when = fraction, now
                print_json(progress=round(fraction, 4), message=message)
        elif self.style == "bar":
            self.bar = self.bar or Bar()
            self.bar(fraction, in_one_line(message))

    def close(self) -> None:
        if self.bar is not None:
            self.bar.close()


def print_json(**fields: Any) -> None:
    """Print one object a line on stdout, with the time, in UTC."""
    print(json.dumps({**fields, "time": datetime.now(UTC).isoformat(timespec="milliseconds")}), flush=True)


def refuse(sentence: str, arguments: Sequence[str]) -> None:
    """Print the error in one line on stderr and, if JSON is requested, on stdout, too."""
    sentence = in_one_line(sentence)
    # Works even if the arguments cannot be parsed.
    if "--progress=json" in arguments or ("--progress", "json") in itertools.pairwise(arguments):
        with contextlib.suppress(OSError):  # the reader is gone
            print_json(error=sentence)
    with contextlib.suppress(OSError):
        print(f"mpsnet: {sentence}", file=sys.stderr)
