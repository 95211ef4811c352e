"""Operations: everything that a user can run, each described once.

An operation is a frozen dataclass. Its inputs, outputs and settings are fields made by :func:`option`. It is the Python
API. The command line (:mod:`mpsnet_core.cli.arguments`) and the add-on's settings
(``blender_addon/settings/declared.py``) are generated from it.
"""

import contextlib
import dataclasses
import functools
import inspect
import math
import os
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from numbers import Integral, Real
from types import UnionType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, Union, dataclass_transform

from mpsnet_core.defaults import CONVENTIONS
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.progress import Bar, Progress, can_show_bar, silent

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# What the provenance of a result records of an option: its value, a hash of the file that it names, the names and
# hashes of the files that it names, or nothing. It applies to each value of an option that takes several.
Provenance = Literal["value", "content", "files", "none"]
# What Blender's file browser offers to select for the option; "" if it is not a path.
PathKind = Literal["", "file", "folder"]

_METADATA = "option"


@dataclass(frozen=True)
class Option:
    """The description of an option, apart from its name, type and default."""

    help: str
    """What it does, as the command line and Blender show it: no flags, no full stop. The command line hides an option
    whose help is empty."""
    positional: bool
    """Whether the command line takes it without a flag."""
    metavar: str | None
    """Placeholder for its value in the help, such as its unit."""
    choices: Mapping[Any, str]
    """The allowed values where they are few, each with its meaning in a line. Checked here."""
    low: float | None
    """Inclusive lower bound of a number. Checked here."""
    high: float | None
    """Inclusive upper bound of a number. Checked here."""
    unset: str
    """Help text for what applies if the option is not given: "16 bits, in OpenEXR 32"."""
    path: PathKind
    """Whether Blender's file browser selects a file or a folder for it."""
    provenance: Provenance
    """What the provenance of a result records of it."""
    numbers: bool
    """Whether its text may be a number, or several with commas. Python may pass these as they are."""

    def words(self, default: Any, several: bool = False) -> str:
        """What it does, its choices, its range, and what applies if it is not given.

        several: whether the command line takes it repeatedly.
        """
        text = self.help
        choices = [f"{value} ({meaning})" if meaning else str(value) for value, meaning in self.choices.items()]
        if choices:
            text += f": {', '.join(choices[:-1])} or {choices[-1]}"
        if several and not self.positional:
            text += "; may be repeated"
        facts = [*filter(None, [self.range, self._default(default)])]
        return text + (f" ({'; '.join(facts)})" if facts else "")

    @property
    def range(self) -> str:
        """The numbers that it takes, in words; "" if it takes all."""
        if self.low is None and self.high is None:
            return ""
        least = _number(-math.inf if self.low is None else self.low)
        return f"{least} or more" if self.high is None else f"{least} to {_number(self.high)}"

    def _default(self, default: Any) -> str:
        if default is dataclasses.MISSING:
            return "" if self.positional else "required"
        values = default if isinstance(default, tuple) else (default,)
        shown = self.unset or ", ".join(_number(one) for one in values if one is not None and one is not False)
        return f"default: {shown}" if shown else ""


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
    provenance: Provenance | None = None,
    numbers: bool = False,
) -> Any:
    """A field of an operation, required if it has no default. See :class:`Option` for the parameters.

    provenance: by default a file's content, and any other value as it is.
    """
    recorded: Provenance = provenance or ("content" if path == "file" else "value")
    described = Option(help, positional, metavar, choices or {}, low, high, unset, path, recorded, numbers)
    return field(default=default, kw_only=True, metadata={_METADATA: described})


def optional(help: str, **more: Any) -> Any:
    """An option that is None by default. more: as for :func:`option`."""
    return option(default=None, help=help, **more)


def output_option(help: str, *, metavar: str = "FILE", **more: Any) -> Any:
    """An option for what is written if it is asked for, which the provenance of results does not record."""
    return option(default=None, help=help, metavar=metavar, provenance="none", **more)


def convention_option(*, default: str, of: str) -> Any:
    """An option for the convention `of` some normals."""
    return option(default=default, choices=CONVENTIONS, help=f"which way the green channel of {of} points")


@dataclass(frozen=True)
class Setting:
    """An option of an operation, with its name and type."""

    name: str
    """The field's name."""
    kind: type
    """The type of one value: ``str``, ``int``, ``float`` or ``bool``."""
    several: bool
    """Whether it takes any number of values."""
    default: Any
    """``dataclasses.MISSING`` if it is required."""
    option: Option
    """The rest of its description."""
    heading: str
    """The heading of the class that declares it."""

    @property
    def required(self) -> bool:
        return self.default is dataclasses.MISSING

    @property
    def flags(self) -> list[str]:
        """Its flags on the command line, the long one last. An ``output`` has a short one, too."""
        return [*(["-o"] if self.name == "output" else []), "--" + self.name.replace("_", "-")]


@dataclass(frozen=True)
class Result:
    """The result of an operation. Fields that are None are left out of its JSON, in nested dataclasses too."""

    text: str = field(kw_only=True)
    """The result in words for the terminal, one line or more."""
    failed: list[str] | None = field(kw_only=True, default=None)
    """Why some inputs of a batch failed although the others were done, a sentence each. The command line then ends as
    for bad input."""
    written: list[str] | None = field(kw_only=True, default=None)
    """The absolute paths of all files that it wrote, by name; None if there are none."""

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show a notebook what a terminal shows."""
        printer.text(self.text)

    def facts(self) -> dict[str, Any]:
        """The result as plain data that JSON can hold."""
        return _facts(self)

    def metrics(self, *names: str) -> dict[str, Any]:
        """The facts that ``--json`` writes: those of these names, or all but text and written if none is named."""
        facts = self.facts()
        return {name: facts[name] for name in names or facts if name in facts and name not in {"text", "written"}}


def _facts(answer: Any) -> dict[str, Any]:
    values = {one.name: getattr(answer, one.name) for one in dataclasses.fields(answer)}
    return {name: _plain_data(value) for name, value in values.items() if value is not None}


def _plain_data(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain_data(one) for one in value]
    return _facts(value) if dataclasses.is_dataclass(value) else value


@dataclass_transform(
    kw_only_default=True, frozen_default=True, field_specifiers=(option, optional, output_option, convention_option)
)
@dataclass(frozen=True)
class Operation:
    """One task with all its inputs and settings. :meth:`run` carries it out.

    A subclass is a frozen dataclass whose docstring's first line is the command's help.
    """

    overwrite: bool = option(
        default=False,
        help="replace existing files whose names you do not give, even those that this program did not make",
        provenance="none",
    )

    command: ClassVar[str] = ""
    """The command's name on the command line: "superpose", "calibrate lights"."""
    listed: ClassVar[bool] = True
    """Whether the help of the command line lists it."""
    heading: ClassVar[str] = ""
    """Heading in the command line's help for the options that this class itself declares."""

    def __post_init__(self) -> None:
        """Raise SettingsError if an option's value is missing, of the wrong type, out of range or not a choice."""
        for setting in settings(type(self)):
            plain = _in_words if setting.option.numbers else _plain
            value = plain(getattr(self, setting.name))
            if setting.several and value is not None:
                value = tuple(map(plain, (value,) if isinstance(value, str) else value))
            if setting.required and (value is None or (setting.several and not value)):
                raise SettingsError(f"{self.command} lacks its option {setting.name}; give it")
            object.__setattr__(self, setting.name, value)
            for one in value if setting.several and value is not None else (value,):
                _check(setting, one)

    def __init_subclass__(cls) -> None:
        """Have :meth:`run` tell what it writes under whose names, see :data:`running`; explain the options."""
        super().__init_subclass__()
        cls.__doc__ = _with_parameters(cls)
        if "run" in vars(cls):
            setattr(cls, "run", _as_running(cls.run))  # noqa: B010 - mypy takes methods for constants

    def texts(self) -> Iterator[str]:
        """The texts that the user gave, among them every path."""
        for setting in settings(type(self)):
            value = getattr(self, setting.name)
            if setting.kind is str and value is not None:
                yield from value if setting.several else (value,)

    def run(self, progress: Progress = silent) -> Result:
        """Carry out the operation.

        progress: called with the share done, 0 to 1, and a message; True for a bar on stderr, False for none. By
        default a bar in a terminal or a notebook. Raises InputError on bad input, Cancelled if `progress` raises it.
        """
        raise NotImplementedError

    @classmethod
    def help(cls) -> str:
        """What the command does, in a line."""
        return (cls.__doc__ or "").split("\n")[0].rstrip(".")


def _with_parameters(kind: type[Operation]) -> str:
    """An operation's docstring with its options. Its class is not a dataclass yet."""
    lines = [inspect.cleandoc(kind.__doc__ or ""), "", "Parameters", "----------"]
    for part in reversed(kind.__mro__):
        own = vars(part).get("__dataclass_fields__") or vars(part)
        for name, hint in inspect.get_annotations(part).items():
            described = getattr(own.get(name), "metadata", {}).get(_METADATA)
            if described and described.help:
                lines += [f"{name} : {inspect.formatannotation(hint)}", f"    {described.words(own[name].default)}"]
    return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Running:
    """An operation that is being carried out, for the rules of :mod:`mpsnet_core.io.files` on what it may overwrite."""

    operation: Operation
    """The operation."""
    written: set[str] = field(default_factory=set)
    """The absolute paths of the files that it wrote so far."""
    read: dict[str, None] = field(default_factory=dict)
    """The absolute paths of the files that it read so far, as keys."""
    folders: list[str] = field(default_factory=list)
    """The folders that it made. If it fails, those that are still empty are removed."""

    @functools.cached_property
    def named(self) -> frozenset[str]:
        """The absolute paths that its options name. A text that is not a path counts as one, which is harmless."""
        return frozenset(map(os.path.abspath, self.operation.texts()))

    @functools.cached_property
    def places(self) -> frozenset[str]:
        """The folders that the user chose: those named, those of the files that are named, and the current one."""
        return self.named | {os.path.dirname(path) for path in self.named} | {os.getcwd()}  # noqa: PTH109, PTH120


# What this thread carries out, None outside of any operation.
running: ContextVar[Running | None] = ContextVar("running", default=None)


def _as_running(run: Callable[[Any, Progress], Any]) -> Callable[..., Any]:
    @functools.wraps(run)
    def wrapped(self: Operation, progress: Progress | bool | None = None) -> Any:
        if progress is None:  # the outermost run shows a bar where somebody watches
            progress = running.get() is None and can_show_bar()
        if isinstance(progress, bool):
            progress = Bar() if progress else silent
        task = Running(self)
        token = running.set(task)
        try:
            result = run(self, progress)
            written = sorted(filter(os.path.exists, task.written))
            return dataclasses.replace(result, written=written or None) if isinstance(result, Result) else result
        except BaseException:
            for folder in reversed(task.folders):
                with contextlib.suppress(OSError):  # it is not empty
                    os.rmdir(folder)  # noqa: PTH106
            raise
        finally:
            running.reset(token)
            if isinstance(progress, Bar):
                progress.close()

    return wrapped


# A cache: evaluating type hints is slow, and Blender's settings are made from them while Blender starts.
_SETTINGS: dict[type[Operation], tuple[Setting, ...]] = {}


def settings(kind: type[Operation]) -> tuple[Setting, ...]:
    """The options of an operation in the order of its fields, positional ones first."""
    if kind not in _SETTINGS:
        _SETTINGS[kind] = _settings(kind)
    return _SETTINGS[kind]


def _settings(kind: type[Operation]) -> tuple[Setting, ...]:
    hints = typing.get_type_hints(kind)
    found = [
        Setting(one.name, *_value_type(hints[one.name]), one.default, one.metadata[_METADATA], _heading(kind, one.name))
        for one in dataclasses.fields(kind)
    ]
    common = {one.name for one in dataclasses.fields(Operation)}  # these come last
    return tuple(sorted(found, key=lambda setting: (not setting.option.positional, setting.name in common)))


def _heading(kind: type[Operation], name: str) -> str:
    declared_in = next(part for part in kind.__mro__ if name in inspect.get_annotations(part))
    return str(vars(declared_in).get("heading", ""))


def _value_type(hint: Any) -> tuple[type, bool]:
    """The type of one value of a field, and whether the field holds several."""
    if typing.get_origin(hint) in (Union, UnionType):
        kinds = [one for one in typing.get_args(hint) if one is not type(None) and one is not os.PathLike[str]]
        return _value_type(kinds[0])
    if typing.get_origin(hint) is tuple:
        return _value_type(typing.get_args(hint)[0])[0], True
    if typing.get_origin(hint) is Literal:
        return type(typing.get_args(hint)[0]), False
    return hint, False


def _plain(value: Any) -> Any:
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def _in_words(value: Any) -> Any:
    """A number, or several, as the command line takes them: "45,90.5"."""
    is_row = isinstance(value, Sequence) or getattr(value, "ndim", 0) == 1  # also an array of NumPy
    numbers = value if is_row else (value,)
    if len(numbers) == 0 or not all(isinstance(one, Real) and not isinstance(one, bool) for one in numbers):
        return _plain(value)
    return ",".join(str(one) if isinstance(one, Integral) else repr(float(one)) for one in numbers)


def _check(setting: Setting, value: Any) -> None:
    if value is None:
        return
    low, high, choices = setting.option.low, setting.option.high, setting.option.choices
    name = setting.name.replace("_", " ")
    if setting.kind is str and not isinstance(value, str | os.PathLike):
        raise SettingsError(f"{name} {value!r} is not text; give text, as on the command line")
    if setting.kind is bool and not isinstance(value, bool):
        raise SettingsError(f"{name} {value!r} is neither true nor false")
    is_truth = isinstance(value, bool)  # which Python counts as a whole number
    if setting.kind is float and (is_truth or not isinstance(value, Real)):
        raise SettingsError(f"{name} {value!r} is not a number")
    if setting.kind is int and (is_truth or not isinstance(value, Integral)):
        raise SettingsError(f"{name} {value!r} is not a whole number")
    if choices:
        check_choice(name, value, choices)
    # "not" rejects NaN, too.
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        raise SettingsError(f"{name} {_number(value)} is out of range; choose {setting.option.range}")


def _number(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


# --- operations as JSON, as a child process receives them: ``{"operation": "mask", "options": {"image": ...}}`` -------


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
