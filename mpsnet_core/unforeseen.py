"""The last resort: what nobody foresaw becomes one sentence, and its traceback a file to report it with."""

import contextlib
import os
import platform
import shlex
import sys
import tempfile
import traceback

from mpsnet_core import __version__
from mpsnet_core.errors import in_one_line

LONGEST_REASON = 120


def unforeseen(error: BaseException) -> str:
    """A sentence that says what happened and how to report it; the traceback goes to a file that the sentence names.

    The file is in the folder for temporary files, under a name that nobody can foresee.
    """
    reason = (traceback.format_exception_only(error)[-1].strip().splitlines() or [type(error).__name__])[-1]
    reason = in_one_line(reason, LONGEST_REASON)
    log = _log_of(error)
    kept = f"its traceback is in {log}; please send that file" if log else "no log could be written; please send this"
    return in_one_line(
        f"this is a fault of the program, not yours ({reason}); {kept} to whoever you have the program from"
    )


def _log_of(error: BaseException) -> str:
    """Write what helps to find the fault into a file of its own and give its name, "" where that cannot be done."""
    lines = [
        f"mpsnet {__version__}, Python {platform.python_version()}, {platform.platform()}\n",
        f"{shlex.join(sys.argv)}\n\n",
        *traceback.format_exception(error),
    ]
    with contextlib.suppress(OSError):
        number, name = tempfile.mkstemp(prefix="mpsnet-", suffix=".log")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines(lines)
        return name
    return ""
