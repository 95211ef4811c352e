"""Delay signals: stop a run between steps, not within one."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def delay_signals() -> Iterator[None]:
    """Hold back the signals that stop the process (Ctrl-C, SIGTERM, SIGBREAK) until the block is done."""
    received: list[int] = []
    handlers = {}
    # Other threads receive no signals and may not set handlers. A handler not set from Python cannot be restored.
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not None:
                handlers[number] = signal.signal(number, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number in received:
        signal.raise_signal(number)
