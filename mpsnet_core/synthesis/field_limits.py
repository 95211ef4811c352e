"""Limits of the fields of jobs, training recipes and capture models, and their check.

Without NumPy, as the command line is made of these limits before it does anything.
"""

import reprlib
from collections.abc import Mapping
from dataclasses import field, fields
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin, get_type_hints

from mpsnet_core.errors import SettingsError, check_choice

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_KINDS: dict[Any, str] = {str: "a text", bool: "true or false", Mapping: "a table", tuple: "a list of names"}


def limited(default: Any, low: float, high: float) -> Any:
    """A field of a dataclass whose numbers are from `low` to `high`, see :func:`limits_of`."""
    return field(default=default, metadata={"limits": (low, high)})


def limits_of(kind: type) -> dict[str, tuple[float, float]]:
    """The limits of a dataclass's fields that were made by :func:`limited`."""
    return {one.name: one.metadata["limits"] for one in fields(kind) if "limits" in one.metadata}


def with_tuples(data: Mapping[str, Any]) -> dict[str, Any]:
    """Values for a dataclass from JSON or TOML, which have lists in place of tuples."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


def check_fields(record: "DataclassInstance", whose: str) -> None:
    """Raise SettingsError if a dataclass's field has another type, is beyond its limits, or is none of its choices.

    Of a pair of numbers, the lower one comes first. whose: of the field, for the message, such as "the job's".
    """
    hints, limits = get_type_hints(type(record)), limits_of(type(record))
    for one in fields(record):
        value, hint, name = getattr(record, one.name), hints[one.name], f"{whose} {one.name}"
        kind = get_origin(hint) or hint
        if kind is Literal:
            check_choice(name, value, get_args(hint))
            continue
        entries = value if kind is tuple and isinstance(value, tuple) else (value,)
        sound = isinstance(value, tuple) or kind is not tuple
        if one.name in limits:
            low, high = limits[one.name]
            words = f"{'a whole number ' if isinstance(low, int) else ''}from {low:.9g} to {high:.9g}"
            sound = sound and len(entries) > 0 and all(_within(entry, low, high) for entry in entries)
            if kind is tuple and Ellipsis not in get_args(hint):
                words = f"the least and the most, each {words}"
                sound = sound and len(entries) == 2 and entries[0] <= entries[1]
        else:
            words, empty = _KINDS[kind], one.default == ""
            sound &= all(isinstance(entry, str if kind is tuple else kind) for entry in entries)
            sound = sound and (empty or "" not in entries)
        if not sound:
            raise SettingsError(f"{name} must be {words}, not {reprlib.repr(value)}")


def _within(value: Any, low: float, high: float) -> bool:
    """Whether it is a number of this range, a whole one where the range's ends are."""
    return type(value) in (int, float) and not (type(value) is float and isinstance(low, int)) and low <= value <= high
