"""The command line: one command, ``mpsnet``, with a subcommand for each verb.

Exit codes: 0; 2 and one line on stderr for bad input; 1 and one line for a fault of the program; 130 when cancelled.
"""

import _thread
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Sequence
from types import FrameType

from mpsnet_core.progress import is_uninterrupted

EXIT_UNFORESEEN = 1
EXIT_BAD_INPUT = 2
EXIT_CANCELLED = 130

RETRY_SECONDS = 0.02


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    # Before NumPy is imported. Even for the inverse of a 4 x 4 matrix OpenBLAS wakes a thread on every core, each of
    # which then waits busily for 20 ms or more. Large work is spread over the cores anyway.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    arguments = list(sys.argv[1:] if argv is None else argv)
    handlers = {}
    for name in ("SIGINT", "SIGTERM", "SIGBREAK"):  # SIGBREAK is how Windows asks a process group to end
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            handlers[number] = signal.signal(number, _stop)
    try:
        # Imported here: Ctrl-C while everything loads must be handled, too.
        from mpsnet_core.cli.command import run

        return run(arguments)
    except KeyboardInterrupt:
        with contextlib.suppress(OSError):
            print("mpsnet: stopped", file=sys.stderr)
        return EXIT_CANCELLED
    except Exception as error:  # noqa: BLE001
        from mpsnet_core.cli.reporter import refuse
        from mpsnet_core.io.crash_log import describe_unexpected_error

        refuse(describe_unexpected_error(error), arguments)
        return EXIT_UNFORESEEN
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt at once, except in two cases, which are tried again a moment later.

    A library that is loading would crash or turn it into an ImportError. A function that is marked as uninterrupted,
    such as the removal of an unfinished file, would leave that file behind.
    """
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>" or is_uninterrupted(frame):
            threading.Timer(RETRY_SECONDS, _thread.interrupt_main, (number,)).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt
