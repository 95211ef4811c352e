"""Operations as JSON, as a child process receives them: ``{"operation": "mask", "options": {"image": ...}}``."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.operation import Operation, Setting, settings

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Facts = TypeVar("Facts", bound="DataclassInstance")

# Numbers of this magnitude or above, infinity and NaN are rejected: no option takes them.
LARGEST = 2**63

_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}


def to_json(operation: Operation) -> dict[str, Any]:
    """The operation with the options that are not at their defaults."""
    given = [(setting, getattr(operation, setting.name)) for setting in settings(type(operation))]
    options = {setting.name: value for setting, value in given if value != setting.default}
    return {"operation": operation.command, "options": options}


def from_json(request: Mapping[str, Any], kinds: Iterable[type[Operation]]) -> Operation:
    """The operation that :func:`to_json` described, which must be one of `kinds`.

    Raises
    ------
    SettingsError
        If the operation is unknown, an option is missing, unknown or of the wrong type, or the operation rejects it.
    """
    command, options = request.get("operation", ""), request.get("options", {})
    commands = {kind.command: kind for kind in kinds}
    check_choice("operation", command, tuple(commands))
    if not isinstance(options, dict) or not request.keys() <= {"operation", "options"}:
        raise SettingsError(f"the request for {command} holds more than its options; send operation and options alone")
    kind = commands[command]
    known = {setting.name: setting for setting in settings(kind)}
    for name in options:
        check_choice(f"option of {command}", name, known)
    for name, setting in known.items():
        if setting.required and name not in options:
            raise SettingsError(f"{command} lacks its option {name}; give it")
    return kind(**{name: _value(command, known[name], value) for name, value in options.items()})


def from_facts(kind: type[Facts], facts: Mapping[str, Any]) -> Facts:
    """A record of a result again from its JSON, which leaves out what is None: see :meth:`.Result.facts`."""
    return kind(**{one.name: facts.get(one.name) for one in dataclasses.fields(kind)})


def _value(command: str, setting: Setting, value: Any) -> Any:
    if value is None and setting.default is None:
        return None
    if not setting.several:
        values = [value]
    elif isinstance(value, list) and (value or not setting.required):
        values = value
    else:
        raise SettingsError(f"{setting.name} of {command} must be a list of values, not {value!r}; give one or more")
    kinds = (int, float) if setting.kind is float else (setting.kind,)
    for one in values:
        # As on the command line, text is neither empty nor holds a null character.
        sound = type(one) in kinds and (one and "\0" not in one if kinds == (str,) else -LARGEST < one < LARGEST)
        if not sound:
            raise SettingsError(f"{setting.name} of {command} must be {_WORDS[setting.kind]}, not {one!r}")
    return tuple(values) if setting.several else value
