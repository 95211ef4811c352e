"""Functions that signals must not interrupt, such as those that clean up."""

from collections.abc import Callable
from types import CodeType, FrameType
from typing import TypeVar

Function = TypeVar("Function", bound=Callable[..., object])

_CODES: set[CodeType] = set()


def uninterrupted(function: Function) -> Function:
    """Mark a Python function, which must be quick: a signal handler that asks :func:`is_uninterrupted` waits for it."""
    _CODES.add(function.__code__)
    return function


def is_uninterrupted(frame: FrameType) -> bool:
    """Whether a frame runs a function that is marked. Its callers are other frames."""
    return frame.f_code in _CODES
