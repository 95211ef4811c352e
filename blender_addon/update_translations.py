"""Bring the translators' catalogs up to date with what the add-on shows.

Run it by ``python -m blender_addon.update_translations``. Messages that are new get an empty translation, those that
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
from blender_addon.manual import groups, operators, shown
from blender_addon.panels.lights import NO_RIG
from blender_addon.panels.models import NAMES as NAMES_OF_MODELS
from blender_addon.panels.step import Kind
from blender_addon.panels.traffic_light import LIGHTS
from blender_addon.photo.find_lights import CHANNEL, UNEXPLAINED
from blender_addon.rig.rig import COLOURS
from blender_addon.translations import LOCALE, one_line
from mpsnet_core.capture.photo_check import ITEMS
from mpsnet_core.estimate.lights.find import SIDES
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.normal_directions import WORDS
from mpsnet_core.scene.rig_check import TURN_WORDS

HERE = Path(__file__).parent
CORE = Path(mpsnet_core.__file__).parent
# The rooms of the core whose notes the panel shows.
_ROOMS = ("arrays", "bake", "calibrate", "capture", "estimate", "io", "relief", "scene")
_WIDTH = 120
# What the code hands to the panel in variables.
_IN_VARIABLES = {
    *(*NAMES_OF_MODELS.values(), CHANNEL, UNEXPLAINED, *COLOURS, "Slant", "Tilt"),
    *(kind.word for kind in Kind),
    *(NO_RIG, *(word for word, _ in LIGHTS.values())),
    # Values of notes.
    *(*CHANNELS, *SIDES, *TURN_WORDS, *WORDS, *ITEMS),
}
# Placeholders and codes.
_NO_WORDS = re.compile(r"%[-.\d]*[a-z]|\[[a-z-]+\]")
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


def noted(file: Path) -> Iterator[str]:
    """The templates of a file's notes: what it logs, if it is the core's, and what it makes notes of."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    assigned = [one for one in ast.walk(tree) if isinstance(one, ast.Assign | ast.AugAssign)]

    def texts(said: ast.expr) -> list[str]:
        if isinstance(said, ast.Constant):
            return [said.value] if isinstance(said.value, str) else []
        if isinstance(said, ast.IfExp):
            return texts(said.body) + texts(said.orelse)
        if isinstance(said, ast.BinOp):
            return [begin + end for begin in texts(said.left) for end in texts(said.right)]
        if not isinstance(said, ast.Name):
            return []
        found = [""]
        for one in sorted(assigned, key=lambda one: one.lineno):  # the last one before it, and what is added to that
            target = one.targets[0] if isinstance(one, ast.Assign) else one.target
            if isinstance(target, ast.Name) and target.id == said.id and one.lineno < said.lineno:
                begun = [""] if isinstance(one, ast.Assign) else found
                found = [begin + end for begin in begun for end in texts(one.value)]
        return [text for text in found if text]

    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and call.args:
            name = call.func.id if isinstance(call.func, ast.Name) else ""
            logs = isinstance(call.func, ast.Attribute) and ast.unparse(call.func) in _LOGS and HERE not in file.parents
            if name == "Note" or logs:
                yield from texts(call.args[0])


def template() -> Catalog:
    """Every message that the add-on shows as it stands."""
    found = {*described(), *_IN_VARIABLES}
    for file in (*HERE.glob("panels/*.py"), HERE / "preferences.py"):
        found |= set(drawn(file))
    for file in (*HERE.rglob("*.py"), *(file for room in _ROOMS for file in (CORE / room).rglob("*.py"))):
        found |= set(noted(file))
    catalog = Catalog()
    for text in sorted(found):
        if any(map(str.isalpha, _NO_WORDS.sub("", text))):
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
