"""The last resort: what nobody foresaw becomes one sentence, and its traceback a file to report it with."""

import contextlib
import os
import platform
import shlex
import sys
import tempfile
import traceback
from pathlib import Path

from mpsnet_core import __version__
from mpsnet_core.errors import in_one_line

LONGEST_REASON = 120


def unforeseen(error: BaseException, folder: Path | None = None) -> str:
    """A sentence that says what happened and how to report it; the traceback goes to a file that the sentence names.

    folder: for the file, that for temporary files unless given. Its name is one that nobody can foresee.
    """
    reason = in_one_line(traceback.format_exception_only(error)[-1].splitlines()[0], LONGEST_REASON)
    log = _log_of(error, folder)
    kept = f"its traceback is in {log}; please send that file" if log else "no log could be written; please send this"
    return in_one_line(
        f"this is a fault of the program, not yours ({reason}); {kept} to whoever you have the program from"
    )


def _log_of(error: BaseException, folder: Path | None) -> str:
    """Write what helps to find the fault into a file of its own and give its name, "" where that cannot be done."""
    lines = [
        f"mpsnet {__version__}, Python {platform.python_version()}, {platform.platform()}\n",
        f"{shlex.join(sys.argv)}\n\n",
        *traceback.format_exception(error),
    ]
    with contextlib.suppress(OSError):
        number, name = tempfile.mkstemp(prefix="mpsnet-", suffix=".log", dir=folder)
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines(lines)
        return name
    return ""
