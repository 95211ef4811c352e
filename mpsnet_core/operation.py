"""Operations: what the project does, each described once.

An operation is a frozen dataclass that holds its inputs, outputs and settings, each a field made by :func:`option`.
It is the Python API, and the command line is generated from it: see :mod:`mpsnet_core.cli.operations`. So are the
add-on's settings: see ``blender_addon/settings/declared.py``.
"""

import dataclasses
import inspect
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from types import UnionType
from typing import Any, ClassVar, Literal, Union, dataclass_transform, get_args, get_origin, get_type_hints

from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.progress import Progress, silent

# Which change of an option changes the result: of its value, of the content of the file that it names, or of the files
# that it names, by their names, sizes and times; or none does. Of an option with several values: of any of them.
Provenance = Literal["value", "content", "files", "none"]
# What a file browser looks for to fill an option in; "" where it has none.
PathKind = Literal["", "file", "folder"]

_METADATA = "option"


@dataclass(frozen=True)
class Option:
    """What an option is, beside its name, type and default.

    Parameters
    ----------
    help
        What it does, for people who meet it on the command line or in Blender: without flags, without a full stop. The
        command line does not list an option without.
    positional
        Whether the command line takes it without a flag.
    metavar
        What stands for its value in the help, its unit for instance.
    choices
        The values that can be, where they are few, and what each means in a line. Checked here.
    low, high
        Bounds of a number, both included. Checked here.
    unset
        What counts where it is None or nothing, for people: "16 bits, in OpenEXR 32".
    path
        Of text that a person chooses in Blender's file browser: a file or a folder.
    provenance
        Which change of it changes the result.
    """

    help: str
    positional: bool
    metavar: str | None
    choices: Mapping[Any, str]
    low: float | None
    high: float | None
    unset: str
    path: PathKind
    provenance: Provenance


def option(
    *,
    default: Any = dataclasses.MISSING,
    help: str,
    positional: bool = False,
    metavar: str | None = None,
    choices: Mapping[Any, str] | None = None,
    low: float | None = None,
    high: float | None = None,
    unset: str = "",
    path: PathKind = "",
    provenance: Provenance = "value",
) -> Any:
    """A field of an operation; one without a default has to be given. See :class:`Option`."""
    described = Option(help, positional, metavar, choices or {}, low, high, unset, path, provenance)
    return field(default=default, kw_only=True, metadata={_METADATA: described})


@dataclass(frozen=True)
class Setting:
    """An option of an operation, with its name and type.

    Parameters
    ----------
    name
        As a field of the operation.
    kind
        The type of one value: ``str``, ``int``, ``float`` or ``bool``.
    several
        Whether it takes any number of values.
    default
        ``dataclasses.MISSING`` where it has to be given.
    option
        What else it is.
    heading
        That of the class which declares it.
    """

    name: str
    kind: type
    several: bool
    default: Any
    option: Option
    heading: str

    @property
    def required(self) -> bool:
        return self.default is dataclasses.MISSING

    @property
    def flags(self) -> list[str]:
        """What stands before its value on the command line, the long flag last; an ``output`` has a short one."""
        return [*(["-o"] if self.name == "output" else []), "--" + self.name.replace("_", "-")]


@dataclass(frozen=True)
class Result:
    """What an operation made. Fields that are None are not part of the answer, also those of dataclasses in it.

    Parameters
    ----------
    text
        For people, a line or more.
    """

    text: str = field(kw_only=True)

    def facts(self) -> dict[str, Any]:
        """The answer as plain data, for programs."""
        return _facts(self)

    def figures(self, *names: str) -> dict[str, Any]:
        """What ``--json`` writes of it: the facts of these names, all but the text where none is named."""
        facts = self.facts()
        return {name: facts[name] for name in names or facts if name in facts and name != "text"}


def _facts(answer: Any) -> dict[str, Any]:
    values = {one.name: getattr(answer, one.name) for one in dataclasses.fields(answer)}
    return {name: _plain_data(value) for name, value in values.items() if value is not None}


def _plain_data(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain_data(one) for one in value]
    return _facts(value) if dataclasses.is_dataclass(value) else value


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(option,))
class Operation:
    """What the project does, with everything it needs; :meth:`run` does it.

    A subclass is a frozen dataclass whose docstring's first line is the command's help.
    """

    # As the command line has it: "superpose", "calibrate lights".
    command: ClassVar[str] = ""
    # Whether the help of the command line lists it.
    listed: ClassVar[bool] = True
    # Above the options that this class itself declares, in the help of the command line.
    heading: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Raises SettingsError where an option's value is lacking, no number, out of bounds or none of its choices."""
        for setting in settings(type(self)):
            value = getattr(self, setting.name)
            if setting.several and value is not None:
                value = tuple(map(_plain, (value,) if isinstance(value, str | os.PathLike) else value))
            if setting.required and (value is None or (setting.several and not value)):
                raise SettingsError(f"{self.command} lacks its option {setting.name}; give it")
            object.__setattr__(self, setting.name, _plain(value))
            for one in value if setting.several and value is not None else (value,):
                _check(setting, one)

    def run(self, progress: Progress = silent) -> Result:
        """Do it. Raises InputError on bad input, and Cancelled where `progress` does."""
        raise NotImplementedError

    @classmethod
    def help(cls) -> str:
        """What the command does, in a line."""
        return (cls.__doc__ or "").split("\n")[0].rstrip(".")


# Type hints take a while to evaluate, and Blender's settings are made from them at its start.
_SETTINGS: dict[type[Operation], tuple[Setting, ...]] = {}


def settings(kind: type[Operation]) -> tuple[Setting, ...]:
    """The options of an operation, those without a flag first, else in the order of its fields."""
    if kind not in _SETTINGS:
        _SETTINGS[kind] = _settings(kind)
    return _SETTINGS[kind]


def _settings(kind: type[Operation]) -> tuple[Setting, ...]:
    hints = get_type_hints(kind)
    found = [
        Setting(one.name, *_value_type(hints[one.name]), one.default, one.metadata[_METADATA], _heading(kind, one.name))
        for one in dataclasses.fields(kind)  # type: ignore[arg-type]  # every subclass is a dataclass
    ]
    return tuple(sorted(found, key=lambda setting: not setting.option.positional))


def _heading(kind: type[Operation], name: str) -> str:
    declared_in = next(part for part in kind.__mro__ if name in inspect.get_annotations(part))
    return str(vars(declared_in).get("heading", ""))


def _value_type(hint: Any) -> tuple[type, bool]:
    """The type of one value of a field, and whether the field holds several."""
    if get_origin(hint) in (Union, UnionType):
        kinds = [one for one in get_args(hint) if one is not type(None) and one is not os.PathLike[str]]
        return _value_type(kinds[0])
    if get_origin(hint) is tuple:
        return _value_type(get_args(hint)[0])[0], True
    if get_origin(hint) is Literal:
        return type(get_args(hint)[0]), False
    return hint, False


def _plain(value: Any) -> Any:
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _check(setting: Setting, value: Any) -> None:
    if value is None:
        return
    low, high, choices = setting.option.low, setting.option.high, setting.option.choices
    name = setting.name.replace("_", " ")
    if setting.kind is str and not isinstance(value, str | os.PathLike):
        raise SettingsError(f"{name} {value!r} is not text")
    if setting.kind is bool and not isinstance(value, bool):
        raise SettingsError(f"{name} {value!r} is neither true nor false")
    if setting.kind is float and not isinstance(value, Real):
        raise SettingsError(f"{name} {value!r} is not a number")
    if setting.kind is int and not isinstance(value, Integral):
        raise SettingsError(f"{name} {value!r} is not a whole number")
    if choices:
        check_choice(name, value, choices)
    # "not" takes care of NaN.
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        least = _number(-math.inf if low is None else low)
        known = f"{least} or more" if high is None else f"{least} to {_number(high)}"
        raise SettingsError(f"{name} {_number(value)} is out of range; choose {known}")


def _number(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
