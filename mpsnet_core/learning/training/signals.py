"""Signals: what stops a run stops it between steps, not within one."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def held_signals() -> Iterator[None]:
    """Let what asks the process to stop (Ctrl-C, SIGTERM, SIGBREAK) wait until the block is done."""
    came: list[int] = []
    handlers = {}
    # Other threads are not asked, and may not touch handlers; one that is not Python's could not be put back.
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not None:
                handlers[number] = signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number in came:
        signal.raise_signal(number)
