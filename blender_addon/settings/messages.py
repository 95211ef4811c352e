"""Messages in the words and the language of the panel.

The core writes options and commands in one notation, that of its command line: "--white-light", "mpsnet superpose".
The command line shows them as they are. Blender shows the labels of its fields and buttons: "White Light", "Make One
Photo".

Every sentence that the panel draws or an operator reports passes through :func:`in_blender`. A note knows its template.
Any other sentence is recognised by the catalog's templates, which the translations are of.
"""

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface

from mpsnet_core.errors import Note

# Translation context of words that Blender's own tables have in another sense: "Mirror Ball" as a command, "Space" as
# free space, "Tangent" of an angle.
OWN_SENSE = "MPS"

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

# By language: the translations of texts without values, and of those with values by their fixed parts.
_WHOLE: dict[str, dict[str, str]] = {}
_SENTENCES: dict[str, list[tuple[list[str], str]]] = {}
_TELLING = 14  # characters of a sentence's own; what has fewer would fit anything, and takes single words alone
PLACEHOLDER = re.compile(r"%[-+.\d]*[a-z]")

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


def store_sentences(language: str, translations: Mapping[str, str]) -> None:
    """Store the translations of texts by the English ones, in which "%s" or "%.1f" stands for a value."""
    known = [(_fixed(english), word) for english, word in translations.items()]
    _WHOLE[language] = {parts[0]: word for parts, word in known if len(parts) == 1}
    several = [one for one in known if len(one[0]) > 1]
    _SENTENCES[language] = sorted(several, key=lambda one: -len("".join(one[0])))  # others may fit as well, but less
    recognised.cache_clear()


def in_blender(message: str) -> str:
    """A message in the language of the panel, with the labels of fields and buttons in place of options and commands.

    Options in brackets that Blender has no field for are left out, with their brackets, and so is "or give" such an
    option. Text that is in Blender's words already stays as it is.
    """
    if isinstance(message, Note):
        parts = PLACEHOLDER.split(message.template)
        # A name in quotation marks stays.
        values = [
            in_blender(one) if isinstance(one, Note) else one if before.endswith('"') else _word(one)
            for before, one in zip(parts, message.values, strict=False)
        ]
        template = in_blender(iface(message.template))
        return template % tuple(values) if values else template
    if bpy.context.preferences.view.use_translate_interface:
        message = recognised(message, bpy.app.translations.locale)
    for hint in (_ALL_OPTIONS, _OR_OPTION):
        message = hint.sub(lambda found: found[0] if {*re.findall(_FLAG, found[0])} <= _LABELS.keys() else "", message)
    return _OPTION.sub(_field, _COMMAND.sub(_button, message))


@lru_cache(maxsize=1000)
def recognised(message: str, language: str) -> str:
    """A message in a language; as it is, if it was made of none of its sentences."""
    if whole := _WHOLE.get(language, {}).get(_uncapitalised(message)):
        return whole
    for parts, word in _SENTENCES.get(language, ()):
        values = _between(_uncapitalised(message), parts)
        if values is None or (len("".join(parts)) < _TELLING and any(" " in value for value in values)):
            continue
        # A name in quotation marks stays.
        shown = [
            value if before.endswith('"') else recognised(value, language)
            for before, value in zip(parts, values, strict=False)
        ]
        return PLACEHOLDER.sub("%s", word) % tuple(shown)
    where, colon, what = message.partition(": ")  # as "Rig 2: starting"
    return f"{recognised(where, language)}: {recognised(what, language)}" if colon else message


def _fixed(sentence: str) -> list[str]:
    """The parts of a sentence around its placeholders."""
    parts = PLACEHOLDER.split(_uncapitalised(sentence))
    return [part.replace("%%", "%") for part in parts] if len(parts) > 1 else parts


def _between(message: str, parts: Sequence[str]) -> list[str] | None:
    """What a message has between these parts of a sentence; None if it has not all of them, in their order."""
    first, last, values = parts[0], parts[-1], []
    at, end = len(first), len(message) - len(last)
    for part in parts[1:-1]:
        found = message.find(part, at, end)
        if found < 0:
            return None
        values.append(message[at:found])
        at = found + len(part)
    return [*values, message[at:end]] if at <= end and message.startswith(first) and message.endswith(last) else None


def _uncapitalised(sentence: str) -> str:
    """A step begins what it lacks with a capital letter, and an error in the middle of another has none."""
    return sentence[:1].lower() + sentence[1:]


def options_in(note: Note) -> list[str]:
    """The options that a note names, in their order, as a field's identifier has them: "white_light"."""
    return [flag.replace("-", "_") for flag in dict.fromkeys(re.findall(_FLAG, note.template))]


def _word(value: Any) -> Any:
    """A value of a note; a single word, as of a colour, in the language of the panel."""
    return iface(value, OWN_SENSE) if isinstance(value, str) else value


def _field(found: re.Match[str]) -> str:
    flag, value = found[1], found[2]
    if flag not in _LABELS:
        return found[0]
    if value is None:
        return iface(_LABELS[flag])
    chosen = _CHOICES.get(flag, {}).get(value)
    return f"{iface(_LABELS[flag])}: {iface(chosen)}" if chosen else f"{iface(_LABELS[flag])} {value}"


def _button(found: re.Match[str]) -> str:
    """The label of the operator that runs a command, without the command's own options."""
    for verb, rest in ((f"{found[1]}_{found[2]}", ""), (found[1], f" {found[2]}" if found[2] else "")):
        operator = getattr(bpy.types, f"MPS_OT_{verb}", None)
        if operator is not None:
            return f"{iface(operator.bl_label, 'Operator')}{rest}"
    return found[0]
