"""Functions that take an object, such as a rig, also take the path of its file."""

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Sequence
from numbers import Real
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import mpsnet_core
from mpsnet_core.errors import SettingsError

T = TypeVar("T", bound=Callable[..., Any])

# The function of the package that reads each kind of object from its file.
READERS = {"Camera": "read_camera", "HeightMap": "read_height", "Image": "read_image"}
READERS |= {"LightRig": "read_rig", "Mesh": "read_mesh", "NormalMap": "read_normals"}


def takes_files(function: T) -> T:
    """The function, or the dataclass, which reads parameters from files where their paths are given.

    Other values that are no object of the annotated class raise SettingsError, wherever this package has that class.
    """
    if inspect.isclass(function):
        setattr(function, "__init__", takes_files(function.__init__))  # noqa: B010 - mypy takes it for unsound
        return function
    signature = inspect.signature(function)
    kinds = {name: _own_kinds(one.annotation) for name, one in signature.parameters.items()}

    @functools.wraps(function)
    def wrapped(*arguments: Any, **named: Any) -> Any:
        bound = signature.bind(*arguments, **named)
        for name, value in bound.arguments.items():
            own, others = kinds[name]
            if own is not None and not isinstance(value, others):
                bound.arguments[name] = _loaded(name, value, own)
        return function(*bound.args, **bound.kwargs)

    return wrapped  # type: ignore[return-value]


def _own_kinds(annotation: Any) -> tuple[Any, tuple[type, ...]]:
    """The class of this package that a parameter has, None if it has none; and the others that it may have."""
    own, others = None, []
    for kind in get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,):
        if getattr(get_args(kind)[0] if get_origin(kind) is Sequence else kind, "__module__", "").startswith("mpsnet_"):
            own = kind
        else:
            others.append(Real if kind is float else get_origin(kind) or kind)
    return own, tuple(others)


def _loaded(name: str, value: Any, kind: Any) -> Any:
    if get_origin(kind) is Sequence:
        if isinstance(value, Sequence) and not isinstance(value, str | list | tuple):
            return value  # it makes its items when they are asked for, as memory may not hold them all
        several = isinstance(value, Iterable) and not isinstance(value, str)
        return [_loaded(name, one, get_args(kind)[0]) for one in (value if several else [value])]
    if isinstance(value, kind):
        return value
    reader = READERS.get(kind.__name__)
    if reader and isinstance(value, str | os.PathLike):
        return getattr(mpsnet_core, reader)(value)
    known = kind.__name__ + (", or the path of its file" if reader else "")
    raise SettingsError(f"{name.replace('_', ' ')} {str(value)[:80]!r} cannot be used; give a {known}")
