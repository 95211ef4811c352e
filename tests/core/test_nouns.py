"""What holds for every dataclass of the package's own names."""

import dataclasses
import inspect
from typing import Any, get_args, get_origin

import numpy as np
import pytest

import mpsnet_core

NOUNS = [
    noun
    for noun in (getattr(mpsnet_core, name) for name in mpsnet_core.__all__)
    if isinstance(noun, type) and dataclasses.is_dataclass(noun) and not issubclass(noun, mpsnet_core.Operation)
]


def holds_arrays(hint: Any) -> bool:
    if get_origin(hint) is np.ndarray:
        return True
    if dataclasses.is_dataclass(hint):
        return any(map(holds_arrays, inspect.get_annotations(hint).values()))
    return any(map(holds_arrays, get_args(hint)))


@pytest.mark.parametrize("noun", NOUNS)
def test_what_holds_arrays_equals_itself_alone(noun: type) -> None:
    """The equality of dataclasses raises where it meets two arrays."""
    assert not holds_arrays(noun) or (noun.__eq__ is object.__eq__ and noun.__hash__ is object.__hash__)
