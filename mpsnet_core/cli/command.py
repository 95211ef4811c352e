"""The command line: parses its arguments, runs an operation, and reports the result."""

import argparse
import contextlib
import errno
import importlib.util
import io
import json
import logging
import mmap
import os
import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpsnet_core import __version__
from mpsnet_core.bake.operations import Bake, BakeViews
from mpsnet_core.bake.scan import Scan
from mpsnet_core.calibrate.operations import CalibrateLights, CalibrateMesh, CalibrateMixing
from mpsnet_core.capture.operations import Check, FindMask, Superpose
from mpsnet_core.cli import EXIT_BAD_INPUT, EXIT_CANCELLED
from mpsnet_core.cli.arguments import Parser, Subparsers, add_operation
from mpsnet_core.cli.reporter import NoteCollector, Reporter, log_level, print_json, refuse
from mpsnet_core.errors import InputError, SettingsError, printable
from mpsnet_core.estimate.alignment.operations import Align
from mpsnet_core.estimate.operations import CalibratePhoto, Estimate, ListModels
from mpsnet_core.io.child_process import only_request
from mpsnet_core.operation import Operation, from_json
from mpsnet_core.relief.operations import Integrate, MakeMaterial
from mpsnet_core.scene.operations import CompareNormals, PreviewLights, WriteCameras
from mpsnet_core.synthesis.operations import Example, MakeSamples, ShowSamples, Synthesize, Work

# Bytes that the libraries and the smallest photo need.
MIN_MEMORY = 256 << 20
# Most further files to name after a command's answer.
MAX_NAMED = 5

# What the help lists, under headings and in this order, each command with the arguments of an example.
SECTIONS: dict[str, dict[type[Operation], str]] = {
    "everyday": {
        Estimate: "photo.dng -o normals.png",
        Superpose: "--channels photo_1.jpg photo_2.jpg photo_3.jpg -o photo.png",
        FindMask: "photo.dng -o mask.png --overlay overlay.png",
        Check: "photo.dng --rig rig.json",
        Scan: "photo.dng --mesh statue.obj -o scanned/",
        Align: "photo.dng --mesh statue.obj --overlay found.png -o camera.json",
        Integrate: "normals.png --camera camera.json --relit relit.png --mesh relief.glb",
        CompareNormals: "normals.png --truth true_normals.png -o errors.png",
        Example: "-o example/",
        ListModels: "",
    },
    "calibrate": {
        CalibrateLights: "ball.dng --focal 50 --overlay found.png -o rig.json",
        CalibrateMixing: "grey.dng --focal 50 --rig rig.json -o rig.json",
        CalibratePhoto: "photo.dng -o rig.json",
        CalibrateMesh: "photo.dng --mesh statue.obj --camera camera.json -o rig.json",
        WriteCameras: "colmap/ --photos photos/ -o cameras/",
    },
    "textures": {
        Bake: "--mesh statue.obj --view camera.json=normals.png -o statue_normal.png",
        BakeViews: "--mesh statue.obj --cameras colmap/ --photos photos/ --rig rig.json -o statue_normal.png",
        MakeMaterial: "cloth.exr --rig rig.json --width 120mm -o cloth/",
    },
    "training": {
        Synthesize: "--count 1000 --seed 1 -o samples/",
        MakeSamples: "samples/",
        ShowSamples: "samples/ -o sheet.png",
    },
}
HIDDEN: tuple[type[Operation], ...] = (PreviewLights, Work)

if importlib.util.find_spec("mpsnet_core.learning"):  # Blender's extension comes without training and evaluation
    from mpsnet_core.learning.evaluation import operations as evaluation
    from mpsnet_core.learning.operations import Train

    SECTIONS["training"] |= {
        Train: "--recipe multiscale --samples training --validation validation -o multiscale.onnx",
        evaluation.EvaluateDiligent: "pmsData",
        evaluation.EvaluateMaterials: "--merl fits.npz",
        evaluation.EvaluateRendered: "meshes",
        evaluation.EvaluateStatues: "meshes",
        evaluation.EvaluateColour: "--size 128 --white",
        evaluation.EvaluateSamples: "validation",
        evaluation.EvaluatePatchSizes: "--samples training --validation validation --runs runs/",
    }

EXAMPLES = {
    kind: f"mpsnet {kind.command} {words}".strip() for section in SECTIONS.values() for kind, words in section.items()
}
OPERATIONS: tuple[type[Operation], ...] = (*EXAMPLES, *HIDDEN)


def run(arguments: Sequence[str]) -> int:
    """Run a verb and return the exit code. Errors other than bad input, I/O and lack of memory are raised."""
    _open_closed_streams()
    notes = NoteCollector()
    core_log = logging.getLogger("mpsnet_core")
    core_log.addHandler(notes)
    core_log.setLevel(logging.INFO)
    core_log.propagate = False
    for stream in (sys.stdout, sys.stderr):  # the encoding of a Windows pipe lacks characters that paths have
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with warnings.catch_warnings():
            if not sys.warnoptions:  # warnings are for developers, who enable them with -W
                warnings.simplefilter("ignore")
            failed = _run(arguments, notes)
        return EXIT_BAD_INPUT if failed else 0
    except (InputError, OSError, MemoryError) as error:
        if _is_closed_pipe(error):
            return EXIT_CANCELLED
        sentence = str(error)
        if isinstance(error, OSError):
            sentence = f"{error.filename or 'output'}: {error.strerror or error}; check the path and its permissions"
        elif isinstance(error, MemoryError):
            sentence = "there is not enough memory; use a smaller size, or smaller photos"
        refuse(sentence, arguments)
        return EXIT_BAD_INPUT
    finally:
        core_log.removeHandler(notes)
        _flush_stdout()


def _is_closed_pipe(error: Exception) -> bool:
    """Whether the reader of the output has closed it, which Windows reports as an invalid argument."""
    if sys.platform == "win32" and isinstance(error, OSError) and not error.filename:
        return error.errno in (errno.EPIPE, errno.EINVAL)
    return isinstance(error, BrokenPipeError)


def _run(arguments: Sequence[str], notes: NoteCollector) -> bool:
    """Run a verb and report its result. Returns whether inputs of a batch failed."""
    notes.setLevel(log_level())
    if "" in arguments:
        raise SettingsError("an argument is empty; check that the shell variable that it comes from is set")
    if not arguments:
        argument_parser().print_help()
        return False
    options = argument_parser(arguments).parse_args(arguments)
    _reserve_memory()
    reporter = Reporter(options.progress)
    try:
        result = options.verb(options, reporter)
    finally:
        reporter.close()
    if reporter.style == "json":
        print_json(result=notes.added_to(result))
        return "failed" in result
    for note in notes.notes:
        print(f"note: {note}", file=sys.stderr)
    if result.get("text"):
        print(printable(result["text"]), flush=True)
    for line in _also_written(result):
        print(printable(line), flush=True)
    for sentence in result.get("failed", ()):
        print(f"mpsnet: {sentence}", file=sys.stderr)
    return "failed" in result


def _also_written(result: dict[str, Any]) -> list[str]:
    """The files that a command wrote and its answer names neither alone, nor as frames, nor by their folder; of many,
    how many."""

    def named(file: Path) -> bool:
        return f"{file.parent}:" in result["text"] or _any_frame(file.name) in _any_frame(result["text"])

    others = [file for file in result.get("written", ()) if not named(Path(file))]
    if len(others) > MAX_NAMED:
        return [f"{len(others)} more files beside {others[0]}"]
    here = Path.cwd()
    return [f"{file.relative_to(here) if file.is_relative_to(here) else file}, too" for file in map(Path, others)]


def _any_frame(text: str) -> str:
    return re.sub(r"#+|\d+", "#", text)


def _reserve_memory() -> None:
    """Raise MemoryError if there is too little memory to load the libraries, which would crash.

    OpenBLAS would wait for ever for the buffer of its first product; a small product allocates it now.
    """
    try:
        mmap.mmap(-1, MIN_MEMORY).close()
    except OSError:
        raise MemoryError from None
    import numpy as np

    np.eye(2) @ np.eye(2)


def _open_closed_streams() -> None:
    """Open closed standard streams (``2>&-``) on the null device.

    The next file to be opened would otherwise get a stream's descriptor, and libraries would write messages into it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    sys.stdout = sys.stdout or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - it stays open
    sys.stderr = sys.stderr or Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115


def _flush_stdout() -> None:
    """Flush stdout, and discard what cannot be written: Python would retry at exit and print messages of its own."""
    stdout = sys.__stdout__
    if stdout is None:  # a windowed program has none
        return
    try:
        stdout.flush()
    except OSError:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), stdout.fileno())


def argument_parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    """The parser of the command line; of the operation alone that `arguments` name, in a tenth of the time."""
    parser = Parser(
        prog="mpsnet",
        description="Surface normals from one photo under red, green and blue light, baked onto the object's UVs.",
    )
    parser.add_argument("--version", action="version", version=f"mpsnet {__version__}")
    with contextlib.suppress(ImportError):  # the extra "completion"
        import shtab

        shtab.add_argument_to(parser, help="print a script for completion with Tab, and exit")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    parser.sections = {heading: [kind.command.split()[0] for kind in kinds] for heading, kinds in SECTIONS.items()}
    common = Parser(add_help=False)
    common.add_argument(
        "--progress",
        choices=("auto", "bar", "json", "none"),
        default="auto",
        help="how to report progress (default: %(default)s)",
    )
    named = [kind for kind in OPERATIONS if kind.command.split() in ([*arguments[:1]], [*arguments[:2]])]
    for operation in named or OPERATIONS:
        add_operation(subparsers, common, operation, EXAMPLES.get(operation, ""))
    _add_job(subparsers, common)
    return parser


def _add_job(subparsers: Subparsers, common: Parser) -> None:
    """Add the command ``job`` for programs, hidden from the help: it runs the operation that stdin holds as JSON.

    It is cancelled if stdin ends before it has finished.
    """

    def verb(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
        request = only_request()
        sys.argv.append(json.dumps(request))  # a crash log holds the command line
        return from_json(request, OPERATIONS).run(reporter.progress).facts()

    subparsers.add_parser("job", parents=[common]).set_defaults(verb=verb)
