"""How settings are declared: once, stored in the scene, shared by the operators.

What an operation of the core has as an option is described there, and made a property of by :func:`from_option`.
"""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from mpsnet_core.operation import Operation, Setting, settings

# Without it Blender fills an operator's unset properties with those of its last run instead of the scene's settings.
GIVEN = {"SKIP_SAVE"}
# Blender paints a path beside the .blend file ("//photo.png") red, as if it were not understood, without the second.
PATH = {*GIVEN, "PATH_SUPPORTS_BLEND_RELATIVE"}

# The context that Blender translates words in which its own tables have in another sense: "Mirror Ball" as a command,
# the "Space" that is free, the "Tangent" of an angle.
OWN_SENSE = "MPS"

# Properties that are stored in the scene and that operators fill in from there.
BoolSetting = partial(BoolProperty, options=GIVEN)
EnumSetting = partial(EnumProperty, options=GIVEN)
FloatSetting = partial(FloatProperty, options=GIVEN)
IntSetting = partial(IntProperty, options=GIVEN)
StringSetting = partial(StringProperty, options=GIVEN)
FileSetting = partial(StringProperty, subtype="FILE_PATH", options=PATH)

_FILE_FORMATS = (
    ("PNG", "PNG", "16-bit PNG"),
    ("TIFF", "TIFF", "16-bit TIFF"),
    ("EXR", "OpenEXR", "32-bit float OpenEXR"),
)

# Whole numbers in Blender have 32 bits.
_LARGEST = 2**31 - 1
_SUBTYPES = {"file": "FILE_PATH", "folder": "DIR_PATH"}
# Choices that are not called as they are written.
_LABELS = {"auto": "Automatic", "srgb": "sRGB", "opengl": "OpenGL", "directx": "DirectX"}

# An identifier, a label and a tooltip.
Item = tuple[str, str, str]


def option_of(operation: type[Operation], name: str) -> Setting:
    """The option of that name."""
    return next(setting for setting in settings(operation) if setting.name == name)


def identifier(value: object) -> str:
    """What Blender calls a value of the core's: upper case, words joined by underscores."""
    return str(value).upper().replace("-", "_")


def items_of(operation: type[Operation], option: str, labels: Mapping[Any, str] | None = None) -> list[Item]:
    """An option's choices. .blend files keep their places in this order: new ones go to the end.

    labels: of those that are not called here as they are written.
    """
    known = {**_LABELS, **(labels or {})}
    choices = option_of(operation, option).option.choices
    return [
        (identifier(value), known.get(value, str(value).title()), _sentence(meaning))
        for value, meaning in choices.items()
    ]


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

    An option that may stay None is 0, "" or the first item here; what that means goes into the description.

    Parameters
    ----------
    operation, option
        What is described there.
    name
        Its label, where it is not the option's name.
    labels, items
        As :func:`items_of` takes them; or the items, where not all of them are the option's choices.
    default, low, unset
        In place of the option's: what is proposed, the smallest value of a number, and what 0 or "" means.
    switch
        Whether the option names a file that the add-on finds a name for: what is set is whether it is written.
    facts
        What concerns Blender alone: ``update``, ``precision``, ``translation_context``.
    """
    setting = option_of(operation, option)
    described = setting.option
    if default is None and not (setting.required or setting.several):
        default = setting.default
    facts = {"name": name or option.replace("_", " ").title(), "description": _sentence(described.help), **facts}
    if switch or setting.kind is bool:
        return BoolSetting(default=bool(default), **facts)
    if items is not None or described.choices:
        items = items_of(operation, option, labels) if items is None else list(items)
        chosen = items[0][0] if default is None else identifier(default)
        return EnumSetting(items=items, default=chosen, **facts)
    empty = described.unset if unset is None else unset
    if empty and not default:
        facts["description"] += f". {'Empty' if setting.kind is str else '0'}: {empty}"
    if setting.kind is str:
        path = {"subtype": _SUBTYPES[described.path], "options": PATH} if described.path else {"options": GIVEN}
        return StringProperty(default=default or "", **path, **facts)
    bounds = {"min": 0 if default is None else described.low if low is None else low, "max": described.high}
    facts.update({bound: value for bound, value in bounds.items() if value is not None})
    if setting.kind is float:
        return FloatSetting(default=default or 0.0, **facts)
    return IntSetting(default=default or 0, **{**facts, "max": min(described.high or _LARGEST, _LARGEST)})


def format_setting(description: str, default: str = "PNG", **facts: Any) -> Any:
    """A property for the file format of a result."""
    return EnumSetting(name="Format", description=description, items=_FILE_FORMATS, default=default, **facts)


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]


def take_given(operator: bpy.types.Operator, settings: type, group: bpy.types.PropertyGroup) -> None:
    """Write what the caller gave the operator to the scene's settings, and fill in the rest from there.

    Afterwards operator and scene agree, and the "Adjust Last Operation" panel shows what was used.
    """
    for name in settings.__annotations__:
        if operator.properties.is_property_set(name):
            setattr(group, name, getattr(operator, name))
        else:
            setattr(operator, name, getattr(group, name))


def as_typed(number: float) -> float:
    """The number that was typed: Blender stores 0.1 as 0.10000000149."""
    return float(f"{number:g}")
