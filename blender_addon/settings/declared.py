"""Declaration of settings: once, stored in the scene, shared by the operators.

Options of the core's operations are described there, and :func:`from_option` makes properties from them.
"""

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.operation import Operation, Setting, settings

from .messages import store_label

# Without it, Blender fills an operator's unset properties from its last run instead of the scene's settings.
GIVEN = {"SKIP_SAVE"}
# Without the second, Blender marks relative paths ("//photo.png") red, as if they were unsupported.
PATH = {*GIVEN, "PATH_SUPPORTS_BLEND_RELATIVE"}

# Given settings that hold for one run alone. In the .blend file, they would lead the runs of its copies to the files of
# the first one.
OF_ONE_RUN = frozenset({"output", "keep"})


def _setting(make: Callable[..., Any], **fixed: Any) -> Callable[..., Any]:
    def declared(name: str, description: str, *, within: tuple[float, float] | None = None, **facts: Any) -> Any:
        if within is not None:
            facts["min"], facts["max"] = within
        return make(name=name, description=description, **fixed, **facts)

    return declared


# Properties that are stored in the scene and that operators fill in from there, by their name and their description.
# within: the least and the largest number.
BoolSetting = _setting(BoolProperty, options=GIVEN)
EnumSetting = _setting(EnumProperty, options=GIVEN)
FloatSetting = _setting(FloatProperty, options=GIVEN)
IntSetting = _setting(IntProperty, options=GIVEN)
StringSetting = _setting(StringProperty, options=GIVEN)
FileSetting = _setting(StringProperty, subtype="FILE_PATH", options=PATH)
# A file that is read: the panel has a list of its own for it, see operators/choose_file.py.
InputSetting = _setting(StringProperty, subtype="FILE_NAME", options=PATH)
FolderSetting = _setting(StringProperty, subtype="DIR_PATH", options=PATH)

# An image of Blender's.
image_pointer = _setting(PointerProperty, type=bpy.types.Image)


def object_pointer(name: str, description: str, *, kind: str = "", **facts: Any) -> Any:
    """A property for an object of Blender's; of one kind, such as "MESH", if it is given."""
    if kind:
        facts["poll"] = lambda _, candidate: candidate.type == kind
    return PointerProperty(name=name, description=description, type=bpy.types.Object, **facts)


_FILE_FORMATS = (
    ("PNG", "PNG", "16-bit PNG"),
    ("TIFF", "TIFF", "16-bit TIFF"),
    ("EXR", "OpenEXR", "32-bit float OpenEXR"),
)

# Integers in Blender have 32 bits.
_LARGEST = 2**31 - 1
# Labels of choices that differ from their values.
_LABELS = {"auto": "Automatic", "srgb": "sRGB", "opengl": "OpenGL", "directx": "DirectX"}

# An identifier, a label and a tooltip.
Item = tuple[str, str, str]

# The options that settings were made of, by the identity of the properties, which are kept with them: see options_of.
_OPTIONS: dict[int, tuple[str, Any]] = {}


def option_of(operation: type[Operation], name: str) -> Setting:
    """The option of that name."""
    return next(setting for setting in settings(operation) if setting.name == name)


def identifier(value: object) -> str:
    """Blender's identifier of a core value: upper case, words joined by underscores."""
    return str(value).upper().replace("-", "_")


def items_of(operation: type[Operation], option: str, labels: Mapping[Any, str] | None = None) -> list[Item]:
    """An option's choices. .blend files store their index: add new ones at the end.

    labels: of choices whose label differs from their value.
    """
    shown = _choice_labels(option_of(operation, option), labels)
    choices = option_of(operation, option).option.choices
    return [(identifier(value), shown[str(value)], _sentence(meaning)) for value, meaning in choices.items()]


def _choice_labels(setting: Setting, labels: Mapping[Any, str] | None) -> dict[str, str]:
    """The label of each choice of an option, by its value."""
    known = {**_LABELS, **(labels or {})}
    return {str(value): known.get(value, str(value).title()) for value in setting.option.choices}


def from_option(
    operation: type[Operation],
    option: str,
    *,
    name: str = "",
    labels: Mapping[Any, str] | None = None,
    items: Iterable[Item] | None = None,
    default: Any = None,
    low: float | None = None,
    unset: str | None = None,
    switch: bool = False,
    **facts: Any,
) -> Any:
    """A property for an option of an operation, with its range, default, choices and description.

    An option that may be None is 0, "" or the first item here. The description says what that means.

    Parameters
    ----------
    operation, option
        The described option.
    name
        The label, if it differs from the option's name.
    labels, items
        See :func:`items_of`; or the items themselves, if they are not just the option's choices.
    default, low, unset
        Override the option's default, its lower bound, and the meaning of 0 or "".
    switch
        Make a switch for an option that names an output file, for which the add-on chooses the name.
    facts
        Arguments of the Blender property: ``update``, ``precision``, ``translation_context``.
    """
    setting = option_of(operation, option)
    described = setting.option
    if default is None and not (setting.required or setting.several):
        default = setting.default
    label = name or option.replace("_", " ").title()
    store_label(option, label, _choice_labels(setting, labels))
    facts = {"name": label, "description": _sentence(described.help), **facts}
    if switch or setting.kind is bool:
        made = BoolSetting(default=bool(default), **facts)
    elif items is not None or described.choices:
        items = items_of(operation, option, labels) if items is None else list(items)
        made = EnumSetting(items=items, default=items[0][0] if default is None else identifier(default), **facts)
    else:
        empty = described.unset if unset is None else unset
        if empty and not default:
            facts["description"] += f". {'Empty' if setting.kind is str else '0'}: {empty}"
        made = _text(setting, default, facts) if setting.kind is str else _number(setting, default, low, facts)
    if not switch:
        _OPTIONS[id(made)] = option, made
    return made


def _text(setting: Setting, default: str | None, facts: Mapping[str, Any]) -> Any:
    file = FileSetting if setting.name == "output" else InputSetting
    make = {"file": file, "folder": FolderSetting}.get(setting.option.path, StringSetting)
    return make(default=default or "", **facts)


def _number(setting: Setting, default: float | None, low: float | None, facts: Mapping[str, Any]) -> Any:
    described = setting.option
    low, high = 0 if default is None else described.low if low is None else low, described.high
    if setting.kind is int:
        high = min(high or _LARGEST, _LARGEST)
    bounds = {bound: value for bound, value in (("min", low), ("max", high)) if value is not None}
    make = FloatSetting if setting.kind is float else IntSetting
    return make(default=default or 0, **{**facts, **bounds})


def setting_names(group: Any) -> list[str]:
    """The names of a step's settings, in order: those that set others come first."""
    # Settings have SKIP_SAVE, so that operators do not take them from their last run; results do not.
    return [one.identifier for one in group.bl_rna.properties if one.is_skip_save]


def _made_of(group: Any) -> dict[str, str]:
    """The options that the settings of a group were made of, by the settings' names."""
    declared = {name: one for part in type(group).__mro__ for name, one in inspect.get_annotations(part).items()}
    return {name: _OPTIONS[id(one)][0] for name, one in declared.items() if id(one) in _OPTIONS}


def option_of_setting(group: Any, option: str) -> str:
    """The name of the setting of a group that was made of an option, or has its name; "" if there is none."""
    made = (name for name, of in _made_of(group).items() if of == option)
    return next(made, option if option in setting_names(group) else "")


def options_of(
    operation: type[Operation], group: Any, *, only: Collection[str] = (), without: Collection[str] = ()
) -> dict[str, Any]:
    """The values of settings as options of an operation: the inverse of :func:`from_option`.

    Settings at 0, "" or an item that is no choice of the option are left out, as is `output`: the operator decides on
    the file.

    Parameters
    ----------
    operation
        The operation. Settings that were made of another one's option count by the option's name.
    group
        A group of settings, or an operator that has them.
    only, without
        The options to take, if not all; and those to leave out.
    """
    found = {}
    known = {setting.name: setting for setting in settings(operation)}
    for name, option in _made_of(group).items():
        if option in known and option not in ("output", *without) and (not only or option in only):
            value = _core_value(known[option], getattr(group, name))
            if value is not None:
                found[option] = value
    return found


def _core_value(setting: Setting, value: Any) -> Any:
    """The value of an option from that of its property; None if it is not given."""
    if setting.option.choices:
        return {identifier(one): one for one in setting.option.choices}.get(str(value))
    if setting.kind is float:
        value = round_as_typed(value)
    elif setting.kind is str and setting.option.path and value:
        value = bpy.path.abspath(value)
    if not value and (setting.default is None or setting.kind is str):
        return None
    return (value,) if setting.several else value


def format_setting(description: str, default: str = "PNG", **facts: Any) -> Any:
    """A property for the file format of a result."""
    return EnumSetting("Format", description, items=_FILE_FORMATS, default=default, **facts)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def apply_given_settings(operator: bpy.types.Operator, group: bpy.types.PropertyGroup) -> None:
    """Copy the operator's given properties to a group of the scene's settings, and the other settings to the operator.

    Afterwards operator and scene agree, except on what is :data:`OF_ONE_RUN`, and the "Adjust Last Operation" panel
    shows the values in use. A report names the settings of the scene that this changed: later steps and runs use them.
    """
    names = setting_names(group)
    shared = [name for name in names if name not in OF_ONE_RUN]
    before = {name: getattr(group, name) for name in shared}
    for name in names:
        if not operator.properties.is_property_set(name):
            setattr(operator, name, getattr(group, name))
        elif name in shared:
            setattr(group, name, getattr(operator, name))
    changed = [group.bl_rna.properties[name].name for name in shared if getattr(group, name) != before[name]]
    if changed and bpy.app.background:
        operator.tell(f"Kept in the scene for later runs too: {', '.join(changed)}")


def round_as_typed(number: float) -> float:
    """The number as it was typed: Blender stores 0.1 as 0.10000000149."""
    return float(f"{number:g}")
