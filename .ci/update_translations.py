"""Bring the translators' catalogs up to date with what the add-on shows.

Run it by ``python .ci/update_translations.py``. Messages that are new get an empty translation, those that
are gone move to the end of the file. ``--check`` writes nothing and only says what is missing; the build of the
extension does that.
"""

import ast
import re
import sys
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import bpy
from babel.messages.catalog import Catalog
from babel.messages.pofile import read_po, write_po

import blender_addon
import mpsnet_core
from blender_addon.bake.before_after import PARTS
from blender_addon.manual import groups, operators, shown
from blender_addon.panels.models import NAMES as NAMES_OF_MODELS
from blender_addon.panels.step import Kind
from blender_addon.panels.traffic_light import LIGHTS
from blender_addon.photo.find_lights import CHANNEL, UNEXPLAINED
from blender_addon.rig.rig import COLOURS
from blender_addon.settings.messages import in_blender
from blender_addon.translations import LOCALE, one_line
from mpsnet_core.capture.photo_check import ITEMS
from mpsnet_core.estimate.lights.find import SIDES
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.normal_directions import WORDS
from mpsnet_core.scene.rig_check import TURN_WORDS

ADDON = Path(blender_addon.__file__).parent
CORE = Path(mpsnet_core.__file__).parent
# The rooms of the core whose notes the panel shows.
_ROOMS = ("arrays", "bake", "calibrate", "capture", "estimate", "io", "relief", "scene")
_WIDTH = 120
# What the code hands to the panel in variables.
_IN_VARIABLES = {
    *(*NAMES_OF_MODELS.values(), CHANNEL, UNEXPLAINED, *COLOURS, "Slant", "Tilt"),
    *(kind.word for kind in Kind),
    *(word for word, _ in LIGHTS.values()),
    *(*PARTS, "Faces"),
    # Values of notes.
    *(*CHANNELS, *SIDES, *TURN_WORDS, *WORDS, *ITEMS),
}
# Placeholders and codes.
_OPTION = re.compile(r"(?<!\S)--[a-z%]")
_NO_WORDS = re.compile(r"%[-.\d]*[a-z]|\[[a-z-]+\]")
# Functions and types that are given a sentence, and among how many of their first arguments it is.
_SAID = {
    **dict.fromkeys(("Note", "NoObject", "Lights", "tell", "poll_message_set", "prefix_errors", "warn", "_lights"), 1),
    **{"progress": 3, "wrapped": 2, "part": 4, "_run_progress": 1, "_one_of": 6},
}
_LOGS = {f"log.{level}" for level in ("info", "warning", "error")}


def described() -> Iterator[str]:
    """The names and tooltips of operators, settings and their choices, and the labels of panels and menus."""
    for _, rna in operators():
        yield from (rna.name, one_line(rna.description))
    for _, rna in (*operators(), *groups()):
        for one in shown(rna):
            if one.name != one.identifier:  # a group of settings has no words of its own
                yield from (one.name, one.description)
            if one.type == "ENUM":
                for item in one.enum_items:
                    yield from (item.name, item.description)
    for name in dir(bpy.types):
        if name.startswith(("MPS_PT_", "MPS_MT_", "MPS_FH_")):
            yield getattr(bpy.types, name).bl_label


def drawn(file: Path) -> Iterator[str]:
    """The texts that a file gives to what it draws, as they stand there."""
    for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        for given in getattr(call, "keywords", ()):
            placeholders = getattr(getattr(call, "func", None), "attr", "") == "column"  # by the settings' names
            if isinstance(call, ast.Call) and (placeholders or given.arg in {"text", "placeholder", "heading"}):
                either = [given.value.body, given.value.orelse] if isinstance(given.value, ast.IfExp) else [given.value]
                yield from (one.value for one in either if isinstance(one, ast.Constant) and isinstance(one.value, str))


def said(file: Path) -> Iterator[str]:
    """The sentences of a file with placeholders for values: errors, notes, progress, and what a step lacks.

    What the core logs becomes notes.
    """
    tree, own = ast.parse(file.read_text(encoding="utf-8")), ADDON in file.parents
    assigned = [one for one in ast.walk(tree) if isinstance(one, ast.Assign | ast.AugAssign)]

    def texts(words: ast.expr) -> list[str]:
        if isinstance(words, ast.Constant):
            return [words.value] if isinstance(words.value, str) else []
        if isinstance(words, ast.JoinedStr):
            parts = [
                str(one.value).replace("%", "%%") if isinstance(one, ast.Constant) else "%s" for one in words.values
            ]
            return ["".join(parts)]
        if isinstance(words, ast.IfExp):
            return texts(words.body) + texts(words.orelse)
        if isinstance(words, ast.BoolOp | ast.Dict):
            return [text for one in words.values for text in texts(one)]
        if isinstance(words, ast.Tuple):
            return [text for one in words.elts for text in texts(one)]
        if isinstance(words, ast.BinOp):
            return [begin + end for begin in texts(words.left) for end in texts(words.right)]
        if not isinstance(words, ast.Name):
            return []
        found = [""]
        for one in sorted(assigned, key=lambda one: one.lineno):  # the last one before it, and what is added to that
            target = one.targets[0] if isinstance(one, ast.Assign) else one.target
            if isinstance(target, ast.Name) and target.id == words.id and one.lineno < words.lineno:
                begun = [""] if isinstance(one, ast.Assign) else found
                found = [begin + end for begin in begun for end in texts(one.value)]
        return [text for text in found if text]

    for one in ast.walk(tree):
        if isinstance(one, ast.Call) and one.args:
            called = one.func.id if isinstance(one.func, ast.Name) else getattr(one.func, "attr", "")
            logs = ast.unparse(one.func) in _LOGS and not own
            if called in _SAID or called.endswith("Error") or logs:
                yield from (text for given in one.args[: _SAID.get(called, 1)] for text in texts(given))
        elif isinstance(one, ast.FunctionDef) and "lacks" in one.name:
            answers = [inner.value for inner in ast.walk(one) if isinstance(inner, ast.Return)]
            yield from (text for answer in answers if answer is not None for text in texts(answer))
        elif isinstance(one, ast.FunctionDef) and one.name == "provenance":
            parts = [part for inner in ast.walk(one) if isinstance(inner, ast.Dict) for part in inner.keys]
            yield from (text for part in parts if part is not None for text in texts(part))
    # Sentences that several functions share.
    shared = (text for one in tree.body * own if isinstance(one, ast.Assign) for text in texts(one.value))
    yield from (text for text in shared if text.count(" ") > 2 and text.isprintable())


def template() -> Catalog:
    """Every message that the add-on shows as it stands."""
    found = {*described(), *_IN_VARIABLES}
    for file in (*ADDON.glob("panels/*.py"), ADDON / "preferences.py"):
        found |= set(drawn(file))
    own = [file for file in ADDON.rglob("*.py") if file.stem != "commands"]  # those are for the command line
    for file in (*own, *(file for room in _ROOMS for file in (CORE / room).rglob("*.py"))):
        found |= set(said(file))
    catalog = Catalog()
    for text in sorted(found):
        # Options that are not the panel's are of messages that Blender does not show.
        if any(map(str.isalpha, _NO_WORDS.sub("", text))) and not _OPTION.search(in_blender(text)):
            catalog.add(text)
    return catalog


def main(arguments: list[str]) -> None:
    blender_addon.register()
    wanted = template()
    for path in sorted(LOCALE.glob("*.po")):
        catalog = read_po(BytesIO(path.read_bytes()))
        catalog.update(wanted, no_fuzzy_matching=True)
        missing = [message.id for message in catalog if message.id and not message.string]
        for text in missing:
            sys.stderr.write(f"{path.name} has no translation of: {text}\n")
        if "--check" not in arguments:
            with path.open("wb") as file:
                write_po(file, catalog, width=_WIDTH, sort_output=True)


if __name__ == "__main__":
    main(sys.argv[1:])
