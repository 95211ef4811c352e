"""``blender -b scene.blend --command mpsnet VERB``: a command line of the operators, with their settings as flags."""

import argparse
import logging
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.cli import EXIT_BAD_INPUT, EXIT_CANCELLED, EXIT_UNFORESEEN
from mpsnet_core.cli.arguments import Parser
from mpsnet_core.cli.reporter import NoteCollector, Reporter, log_level, print_json, refuse
from mpsnet_core.errors import FileError, InputError, in_one_line
from mpsnet_core.io.crash_log import describe_unexpected_error

from .estimate.decode_video import decode_video
from .openimageio import load_openimageio
from .operators import progress, reporting
from .operators.reporting import CANCELLED
from .photo.background_render import render_job
from .scene.objects import find_object, refuse_unselectable, select
from .settings.record import result_of

COMMAND = "mpsnet"
# Up to this many files are listed one by one.
LISTED = 12
VERBS = (
    "try_it",
    "scan",
    "add_rig",
    "calibrate_lights",
    "calibrate_mixing",
    "render_photo",
    "open_photo",
    "superpose",
    "check_photo",
    "align_photo",
    "show_mask",
    "render_truth",
    "estimate",
    "unwrap",
    "bake",
    "bake_views",
    "displace",
    "integrate",
    "make_material",
    "render_samples",
)

# The operators whose results are those of a verb that runs several.
_PARTS = {
    "try_it": ("render_photo", "estimate", "bake"),
    "scan": ("align_photo", "calibrate_lights", "estimate", "bake"),
}


def main(argv: Sequence[str]) -> int:
    """Run one verb on the open file and return the exit code.

    It is 0; 2 with one sentence on stderr for bad input; 1 with one for a fault of the program outside its operators;
    130 if cancelled. Notes and the progress of longer work are on stderr; ``--progress json`` has all of it on stdout,
    as the package's own command line does: one JSON object a line.
    """
    try:
        options = vars(argument_parser().parse_args(argv))
        verb = options.pop("verb")
        if verb == "work":
            load_openimageio()
            from .training.samples.render import work

            work(options["path"])
            return 0
        if verb == "render":
            return render_job(Path(options["path"]))
        if verb == "decode":
            decode_video(Path(options["path"]))
            return 0
        _refuse_unopened(sys.argv)
        with _window():
            style = options.pop("progress")
            _do(verb, options, Reporter("json" if style == "json" else "none"))
    except (InputError, RuntimeError) as error:
        # Blender turns an operator's report into a RuntimeError with a prefix.
        sentence = in_one_line(str(error)).removeprefix("Error: ")
        if sentence.startswith("Python: Traceback"):
            refuse(describe_unexpected_error(error), argv)
            return EXIT_UNFORESEEN
        refuse(sentence, argv)
        return EXIT_CANCELLED if sentence == CANCELLED else EXIT_BAD_INPUT
    except SystemExit as leaving:  # --help
        return int(leaving.code or 0)
    except Exception as error:  # noqa: BLE001
        refuse(describe_unexpected_error(error), argv)
        return EXIT_UNFORESEEN
    return 0


def _refuse_unopened(arguments: Sequence[str]) -> None:
    """Raise FileError if Blender was to open a file and has its default scene instead: it goes on as if all were well.

    arguments: Blender's own.
    """
    before = list(arguments[1 : arguments.index("--command")]) if "--command" in arguments else []
    named = [
        word
        for place, word in enumerate(before)
        if re.search(r"\.blend\d*$", word, re.IGNORECASE)
        or (not word.startswith("-") and before[max(place - 1, 0)] in {"-b", "--background"})
    ]
    if named and not bpy.data.filepath:
        reason = "Blender cannot read it" if Path(named[-1]).is_file() else "there is no such file"
        raise FileError(f"cannot open {named[-1]}: {reason}; check the path")


def _do(verb: str, options: dict[str, Any], reporter: Reporter) -> None:
    names, save = options.pop("object"), options.pop("save")
    reporter.progress(0.0, "starting")
    _select(names)
    if save and not Path(save).resolve().parent.is_dir():
        raise FileError(f"cannot save {save}: its folder does not exist; create it first")
    if verb == "render_photo" and not any(word.startswith(("-P", "--python")) for word in sys.argv):
        options.setdefault("resume", True)  # the scene is what its file holds
    operator = getattr(bpy.ops.mps, verb)
    if not operator.poll():
        raise InputError(getattr(bpy.types, f"MPS_OT_{verb}").lacks(bpy.context))
    with _reported(reporter) as notes:
        operator(**options)
    if save:
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(save).resolve()))
    result = _result(verb, every_rig=options.get("all_rigs", False))
    if reporter.style == "json":
        saved = str(Path(save).resolve()) if save else None
        print_json(result=notes.added_to({"command": verb.replace("_", "-"), **result, "saved": saved}))
        return
    print(f"{COMMAND}: {verb.replace('_', '-')} done{_listed(result['written'])}")  # noqa: T201
    if save:
        print(f"{COMMAND}: scene saved as {save}")  # noqa: T201
    elif verb not in {"render_samples", "check_photo"}:
        print(f"{COMMAND}: the scene is not saved; --save FILE.blend keeps what the next step needs")  # noqa: T201


def _result(verb: str, *, every_rig: bool) -> dict[str, Any]:
    """What a verb made: what there is to say of it and "written", the files of all rigs if it worked with every rig."""
    verbs = _PARTS.get(verb, (verb,))
    mps = bpy.context.scene.mps
    places = [*(mps.every_rig if every_rig else ()), mps]
    results = [result_of(one, step) for step in verbs for one in places]
    files = [file for result in results for file in result.get("written", [])]
    return {**next(filter(None, results), {}), "written": list(dict.fromkeys(files))}


def _listed(files: Sequence[str]) -> str:
    """The files as the end of a sentence; of many, the first and the last."""
    shown = [files[0], f"{len(files) - 2} more", files[-1]] if len(files) > LISTED else files
    return f": {', '.join(shown)}" if files else ""


def _window() -> AbstractContextManager[Any]:
    """The context with the file's window: with --command there is none, but Blender's importers need one."""
    windows = bpy.context.window_manager.windows
    if bpy.context.window is not None or not windows:
        return nullcontext()
    return bpy.context.temp_override(window=windows[0])


@contextmanager
def _reported(reporter: Reporter) -> Iterator[NoteCollector]:
    """Within the with block, notes and progress are reported as they come. Yields the notes."""
    notes, lines, logger = NoteCollector(), logging.StreamHandler(sys.stderr), logging.getLogger(__package__)
    lines.setFormatter(logging.Formatter(f"{COMMAND}: %(message)s"))
    level, shown = logger.level, log_level()
    notes.setLevel(shown)
    lines.setLevel(shown)
    logger.setLevel(logging.INFO)
    handled = ((reporting.log, notes), (progress.log, lines))
    for log, handler in handled:
        log.addHandler(handler)
    progress.listeners.append(reporter.progress)
    try:
        yield notes
    finally:
        progress.listeners.remove(reporter.progress)
        for log, handler in handled:
            log.removeHandler(handler)
        logger.setLevel(level)
        for note in notes.notes:
            print(f"note: {note}", file=sys.stderr)  # noqa: T201


def _select(names: Sequence[str]) -> None:
    if not names:
        return
    layer = bpy.context.view_layer
    for name in names:
        if find_object(bpy.context.scene, name) not in set(layer.objects):
            raise InputError(f'"{name}" is in no collection of this view layer; include one of its collections')
        if len(names) > 1:  # a hidden one may still be the active one
            refuse_unselectable(layer.objects[name])
    objects = [layer.objects[name] for name in names]
    select(layer, objects, objects[-1])


def argument_parser() -> argparse.ArgumentParser:
    """The parser of the command line."""
    parser = Parser(prog=COMMAND, description="A normal texture from one photo under red, green and blue light.")
    verbs = parser.add_subparsers(metavar="COMMAND", required=True)
    for verb in VERBS:
        kind = getattr(bpy.ops.mps, verb).get_rna_type()
        sub = verbs.add_parser(
            verb.replace("_", "-"),
            help=kind.description.splitlines()[0],
            description=kind.description,
            argument_default=argparse.SUPPRESS,
        )
        sub.set_defaults(verb=verb, object=[], save="")
        selecting = "select this object first; may be repeated, the last is active"
        sub.add_argument("--object", action="append", metavar="NAME", help=selecting)
        sub.add_argument("--save", metavar="FILE", help="save the scene as this .blend file afterwards")
        told = "how progress and the result are reported: as text, one JSON object a line, or not at all"
        sub.add_argument("--progress", choices=("auto", "json", "none"), default="auto", help=told)
        for setting in kind.properties:
            if setting.identifier != "rna_type" and not setting.is_hidden:
                _add_flag(sub, setting)
    for verb in ("work", "render", "decode"):  # hidden, without help: started by the farm and the add-on
        started = verbs.add_parser(verb)
        started.add_argument("path")
        started.set_defaults(verb=verb)
    return parser


def _add_flag(parser: argparse.ArgumentParser, setting: Any) -> None:
    flag = "--" + setting.identifier.replace("_", "-")
    words = setting.description.replace("%", "%%")
    if setting.type == "BOOLEAN":
        parser.add_argument(flag, action=argparse.BooleanOptionalAction, help=words)
        return
    if setting.type == "ENUM" and setting.is_enum_flag:
        choices = [item.identifier for item in setting.enum_items]
        words = f"{words}: {', '.join(choices)} (the scene's own, all when new)"
        parser.add_argument(flag, type=_several(choices), metavar="NAME,NAME", help=words)
        return
    new = f"{setting.default:g}" if setting.type == "FLOAT" else setting.default
    default = f" (the scene's own, {new} when new)" if new != "" else ""
    if setting.type == "ENUM":
        choices = [item.identifier for item in setting.enum_items]
        parser.add_argument(flag, type=str.upper, choices=choices, help=words + default)
    elif setting.type == "STRING":
        metavar = {"FILE_PATH": "FILE", "FILE_NAME": "FILE", "DIR_PATH": "DIR"}.get(setting.subtype, "NAME")
        parser.add_argument(flag, type=str if metavar == "NAME" else _absolute, metavar=metavar, help=words)
    else:
        parser.add_argument(flag, type=integer if setting.type == "INT" else float, metavar="N", help=words + default)


def _absolute(path: str) -> str:
    """Resolve a path against the working directory, not against the .blend file as Blender does."""
    if path.startswith("//"):
        return path
    return f"{Path(path).resolve()}{'/' * path.endswith(('/', os.sep))}"  # a trailing slash requests a folder


def _several(choices: Sequence[str]) -> Any:
    """A parser of comma-separated names, each one of `choices`."""

    def parse(text: str) -> set[str]:
        names = text.upper().split(",")
        unknown = [name for name in names if name not in choices]
        if unknown:
            raise argparse.ArgumentTypeError(f"{unknown[0]!r} is none of {', '.join(choices)}")
        return set(names)

    return parse


def integer(text: str) -> int:
    """A whole number that Blender can hold. The operator refuses one outside of its setting's range."""
    if abs(number := int(text)) >= 2**31:
        raise ValueError
    return number


_handle: list[Any] = []


def register() -> None:
    _handle.append(bpy.utils.register_cli_command(COMMAND, main))


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handle.pop())
