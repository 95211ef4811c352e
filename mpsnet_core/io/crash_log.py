"""Unexpected errors: one sentence for the user, the traceback in a file to report."""

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

# The runtime that onnxruntime, OpenImageIO and LibRaw need on Windows and do not ship.
VISUAL_C_RUNTIME = "https://aka.ms/vs/17/release/vc_redist.x64.exe"


def describe_unexpected_error(error: BaseException, folder: Path | None = None) -> str:
    """A sentence on what happened and how to report it, with the path of a file with the traceback.

    folder: of that file, whose name is random; the system's temporary folder by default.
    """
    reason = in_one_line(traceback.format_exception_only(error)[-1].splitlines()[0], LONGEST_REASON)
    if isinstance(error, ImportError) and "DLL load failed" in reason:  # Windows does not name the DLL
        return f"a library cannot be loaded ({reason}); install Microsoft's Visual C++ runtime from {VISUAL_C_RUNTIME}"
    log = _write_log(error, folder)
    advice = f"its traceback is in {log}; please send that file" if log else "no log could be written; please send this"
    return in_one_line(f"this is a fault of the program, not yours ({reason}); {advice} to its makers")


def _write_log(error: BaseException, folder: Path | None) -> str:
    """Write versions, command line and traceback to a new file. Returns its path, "" if it cannot be written."""
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
