"""The core's messages in the words of the panel.

The core writes options and commands in one notation, that of its command line: "--white-light", "mpsnet superpose".
The command line shows them as they are. Blender shows the labels of its fields and buttons: "White Light", "Make One
Photo".
"""

import re
from collections.abc import Mapping

import bpy

# The labels of options that settings are not made of, and of those whose settings have another meaning.
_LABELS = {
    "camera": "Camera",
    "circle": "Outline by Hand",
    "crop": "Crop",
    "format": "Format",
    "lens": "Lens Of",
    "level": "Detail Only",
    "mask": "Mask",
    "output": "File",
    "rig": "Rig File",
    "size": "Size",
}
# The labels of options' choices.
_CHOICES: dict[str, dict[str, str]] = {}

# Not a part of a path or a name, as in "photos/--mask.png".
_FLAG = r"(?<![\w/\\\"'-])--([a-z]+(?:-[a-z]+)*)(?![\w-]|\.\w|[=/\\])"
_OPTION = re.compile(rf"{_FLAG}(?: ([a-z0-9-]+))?")
_ALL_OPTIONS = re.compile(r" \((--[^()]*)\)")
_OR_OPTION = re.compile(rf",? or give {_FLAG}")
# Not one with its files, which is to be run as it is.
_COMMAND = re.compile(rf"mpsnet ([a-z]+)(?: ([a-z]+)(?![./-]\w))?((?: {_FLAG})*)(?!\w|[./-]\w|\s+-|\s+[^\s\[]*[./]\w)")


def store_label(option: str, label: str, choices: Mapping[str, str]) -> None:
    """Store the label of a setting that is made of an option, and those of its choices by their values."""
    flag = option.replace("_", "-")
    _LABELS.setdefault(flag, label)
    _CHOICES.setdefault(flag, dict(choices))


def in_blender(message: str) -> str:
    """A message of the core with the labels of fields and buttons in place of options and commands.

    Options in brackets that Blender has no field for are left out, with their brackets, and so is "or give" such an
    option. Text that is in Blender's words already stays as it is.
    """
    for hint in (_ALL_OPTIONS, _OR_OPTION):
        message = hint.sub(lambda found: found[0] if _known(found[0]) else "", message)
    return _OPTION.sub(_field, _COMMAND.sub(_button, message))


def _known(options: str) -> bool:
    return all(flag in _LABELS for flag in re.findall(_FLAG, options))


def _field(found: re.Match[str]) -> str:
    flag, value = found[1], found[2]
    if flag not in _LABELS:
        return found[0]
    if value is None:
        return _LABELS[flag]
    chosen = _CHOICES.get(flag, {}).get(value)
    return f"{_LABELS[flag]}: {chosen}" if chosen else f"{_LABELS[flag]} {value}"


def _button(found: re.Match[str]) -> str:
    """The label of the operator that runs a command, without the command's own options."""
    for verb, rest in ((f"{found[1]}_{found[2]}", ""), (found[1], f" {found[2]}" if found[2] else "")):
        operator = getattr(bpy.types, f"MPS_OT_{verb}", None)
        if operator is not None:
            return f"{operator.bl_label}{rest}"
    return found[0]
