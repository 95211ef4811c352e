"""The pages of the reference that follow from the code: the command line, the Python API, and Blender's operators.

``conf.py`` writes them before each build; they are not kept.
"""

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mpsnet_core
from mpsnet_core.cli.command import OPERATIONS
from mpsnet_core.operation import Operation, Setting, settings

# Titles of the subpackages, for people who look for a function.
SUBPACKAGES = {
    "operation": "Operations in general",
    "capture": "Photos and masks",
    "calibrate": "Calibration",
    "estimate": "Normals",
    "bake": "Textures",
    "relief": "Heights, meshes and materials",
    "scene": "Cameras, rigs, meshes and normal maps",
    "io": "Files",
    "arrays": "Measures",
    "synthesis": "Training data",
    "learning": "Training",
    "errors": "Errors",
}


def write(folder: Path) -> None:
    """Write the pages into the folder of the reference."""
    pages = {"command_line": command_line(), "python": python(), "blender": blender()}
    for name, lines in pages.items():
        text = "\n".join(lines) + "\n"
        page = folder / f"{name}.md"
        # Sphinx reads a page again where its time has changed.
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def write_redirects(folder: Path) -> None:
    """Write a page for each place of the built page of Blender's operators: no other program can open a place within a
    page on Windows.

    folder: of the built pages of the reference.
    """
    page = folder / "blender.html"
    if page.exists():  # as it is in HTML alone
        (folder / "at").mkdir(exist_ok=True)
        for name in re.findall(r'id="(bpy\.[^"]+)"', page.read_text(encoding="utf-8")):
            refresh = f'<meta http-equiv="refresh" content="0; url=../blender.html#{name}">'
            (folder / "at" / f"{name}.html").write_text(f"<!DOCTYPE html>\n{refresh}\n", encoding="utf-8")


def command_line() -> Iterator[str]:
    """Each command with its options."""
    yield "# Command line"
    yield ""
    yield "`mpsnet COMMAND --help` prints the same. Every command also takes `--progress bar`, `json` or `none`."
    yield "It ends with 0; with 2 and one sentence for bad input; with 1 for a fault of the program; with 130 when you"
    yield "cancel it."
    for kind in sorted((one for one in OPERATIONS if one.listed), key=lambda one: one.command):
        yield from ("", f"## mpsnet {kind.command}", "", f"{kind.help()}.")
        yield from _rest_of_docstring(kind)
        groups: dict[str, list[Setting]] = {"": []}  # what has no heading comes first, as with --help
        for setting in settings(kind):
            if setting.option.help:
                groups.setdefault("" if setting.option.positional else setting.heading, []).append(setting)
        for heading, group in groups.items():
            if heading:
                yield from ("", f"**{heading[:1].upper()}{heading[1:]}**")
            for setting in group:
                yield from ("", _flag(setting), f": {_described(setting)}")


def _rest_of_docstring(kind: type[Operation]) -> Iterator[str]:
    """What an operation says below its first line, up to the list of its parameters."""
    text = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[2].partition("\n\nParameters\n")[0]
    if text and not text.startswith(("Parameters", "Examples", "Raises", "Notes", "See Also")):
        yield from ("", text.replace("``", "`"))


def _flag(setting: Setting) -> str:
    if setting.option.positional:
        return f"`{setting.name.upper()}`"
    value = "" if setting.kind is bool else f" {setting.option.metavar or setting.name.rpartition('_')[2].upper()}"
    return ", ".join(f"`{name}{value}`" for name in setting.flags)


def _described(setting: Setting) -> str:
    """What an option does, its choices and bounds, and what applies where it is not given, in sentences."""
    one = setting.option
    text = _with_placeholders(one.help[:1].upper() + one.help[1:])
    if one.choices:
        choices = [f"`{value}`" + (f" ({meaning})" if meaning else "") for value, meaning in one.choices.items()]
        text += ": " + ", ".join(choices)
    text += "."
    if one.low is not None or one.high is not None:
        least, most = (None if bound is None else f"{bound:,}".removesuffix(".0") for bound in (one.low, one.high))
        text += f" From {least} on." if most is None else f" Up to {most}." if least is None else f" {least} to {most}."
    if setting.several and not one.positional:
        text += " You can repeat it."
    if setting.required:
        return text + " **Required.**"
    values = setting.default if isinstance(setting.default, tuple) else (setting.default,)
    default = one.unset or ", ".join(f"`{value}`" for value in values if value not in (None, False, ""))
    return text + (f" Default: {default}." if default else "")


def _with_placeholders(text: str) -> str:
    """A text with <UDIM> as code: Markdown takes it for a tag, and a browser shows nothing."""
    return re.sub(r"<[A-Z]+>", r"`\g<0>`", text)


def python() -> Iterator[str]:
    """Every name of the package, by subpackage."""
    yield "# Python"
    yield ""
    yield "All names come from `mpsnet_core`: `from mpsnet_core import Estimate`. Arrays are NumPy arrays. Camera space"
    yield "is x right, y up, z towards the camera. Bad input raises `InputError`, whose subclasses say what is bad: a"
    yield "file, a format, a geometry, or settings."
    homes = {name: getattr(mpsnet_core, name) for name in mpsnet_core.__all__}
    subpackages = {name: home.split(".")[1] for name, home in mpsnet_core._HOME.items()}
    for subpackage, title in SUBPACKAGES.items():
        names = [name for name in homes if subpackages[name] == subpackage]
        yield from ("", f"## {title}")
        for name in sorted(names, key=lambda name: (not inspect.isclass(homes[name]), name)):
            thing = homes[name]
            kind = "autoclass" if inspect.isclass(thing) else "autofunction" if callable(thing) else "autodata"
            signature = "(**options)" if inspect.isclass(thing) and issubclass(thing, Operation) else ""
            yield from ("", "```{eval-rst}", f".. {kind}:: mpsnet_core.{name}{signature}")
            if inspect.isclass(thing) and not issubclass(thing, (Operation, Exception)):
                yield "   :members:"
            yield "```"
    missing = set(subpackages.values()) - set(SUBPACKAGES)
    if missing:
        raise RuntimeError(f"subpackages without a title in the reference: {sorted(missing)}")


def blender() -> Iterator[str]:
    """The operators with their properties, and the settings in the scene."""
    yield "# Blender's operators and settings"
    yield ""
    yield "Every button of the panel is an operator, every field a setting of the scene. Scripts call the operators as"
    yield "`bpy.ops.mps.bake(size=2048)`: an operator takes the settings of its step as arguments. Bad input raises"
    yield "`RuntimeError` with one sentence."
    try:
        import bpy
    except ImportError:
        yield from ("", "This copy of the page was built without `bpy`, so the lists are missing.")
        return
    import blender_addon
    from blender_addon import manual

    alone = not hasattr(bpy.types.Scene, "mps")
    if alone:
        blender_addon.register()
    yield from ("", "## Operators")
    for name, facts in manual.operators():
        words = f"**{facts.name}.** {' '.join(facts.description.split())}"
        # The add-on looks for these anchors, see `blender_addon.manual`.
        yield from (
            "",
            f'<span id="{name}"></span>',
            "",
            f"### {name}",
            "",
            words if words.endswith(".") else words + ".",
        )
        for one in manual.shown(facts):
            yield from _property(one)
    yield from ("", "## Settings")
    for name, facts in manual.groups():
        yield from ("", f"### {name}")
        for one in manual.shown(facts):
            yield from _property(one, f'<span id="{manual.anchor(facts, one.identifier)}"></span>')
    if alone:
        blender_addon.unregister()


def _property(one: Any, anchor: str = "") -> Iterator[str]:
    yield from ("", f"{anchor}`{one.identifier}`")
    words = [f"**{one.name}.**", *([f"{one.description}."] if one.description else [])]
    if one.type == "ENUM" and 0 < len(one.enum_items) < 20:
        words.append("One of " + ", ".join(f"`{item.identifier}`" for item in one.enum_items) + ".")
    yield ": " + _with_placeholders(" ".join(" ".join(words).split()))


if __name__ == "__main__":
    write(Path(__file__).parent / "reference")
