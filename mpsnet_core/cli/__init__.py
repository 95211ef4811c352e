"""The command line: one command, ``mpsnet``, with a subcommand for each verb.

Exit codes: 0; 2 and one line on stderr for bad input; 130 when cancelled.
"""

import argparse
import contextlib
import io
import itertools
import json
import logging
import signal
import sys
from collections.abc import Sequence
from typing import Any

from mpsnet_core import __version__
from mpsnet_core.cli import (
    bake,
    calibration,
    cameras,
    evaluation,
    integrate,
    masks,
    material,
    photos,
    samples,
    training,
    views,
)
from mpsnet_core.cli.arguments import Parser
from mpsnet_core.cli.reporter import Notes, Reporter
from mpsnet_core.errors import Cancelled, InputError

EXIT_BAD_INPUT = 2
EXIT_CANCELLED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and give its exit code."""
    for name in ("SIGTERM", "SIGBREAK"):  # SIGBREAK is how Windows asks a process group to end
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _cancel)
    notes = Notes()
    core_log = logging.getLogger("mpsnet_core")
    core_log.addHandler(notes)
    core_log.setLevel(logging.INFO)
    core_log.propagate = False
    for stream in (sys.stdout, sys.stderr):  # a Windows pipe cannot hold every path's letters
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    arguments = list(sys.argv[1:] if argv is None else argv)
    reporter = Reporter("json" if _wants_json(arguments) else "none")
    try:
        if "" in arguments:
            raise InputError("an argument is empty; is a shell variable that it comes from not set?")
        if not arguments:
            _parser().print_help()
            return 0
        options = _parser().parse_args(arguments)
        reporter = Reporter(options.progress)
        result = options.verb(options, reporter)
        reporter.close()
        if reporter.style == "json":
            print(json.dumps({"result": {**result, "notes": notes.lines}}), flush=True)
        else:
            for line in notes.lines:
                print(f"note: {line}", file=sys.stderr)
            if result.get("text"):
                print(result["text"])
        return 0
    except BrokenPipeError:  # whoever read our words has gone
        return EXIT_CANCELLED
    except (InputError, OSError, MemoryError) as error:
        reporter.close()
        sentence = str(error)
        if isinstance(error, OSError):
            sentence = f"{error.filename or 'output'}: {error.strerror or error}; check the path and its permissions"
        elif isinstance(error, MemoryError):
            sentence = "there is not enough memory; take a smaller size, or smaller photos"
        sentence = " ".join(sentence.split())
        with contextlib.suppress(BrokenPipeError):  # nobody reads the answer any more
            if reporter.style == "json":
                print(json.dumps({"error": sentence}), flush=True)
            print(f"mpsnet: {sentence}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except (Cancelled, KeyboardInterrupt):
        reporter.close()
        return EXIT_CANCELLED
    finally:
        core_log.removeHandler(notes)


def _cancel(*_: Any) -> None:
    raise Cancelled


def _wants_json(arguments: Sequence[str]) -> bool:
    """Whether ``--progress json`` is asked for, known even where the arguments cannot be parsed."""
    return "--progress=json" in arguments or ("--progress", "json") in itertools.pairwise(arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="mpsnet",
        description="Surface normals from one photo under red, green and blue light, baked onto the object's UVs.",
    )
    parser.add_argument("--version", action="version", version=f"mpsnet {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    common = Parser(add_help=False)
    common.add_argument(
        "--progress", choices=("auto", "bar", "json", "none"), default="auto", help="how to tell progress"
    )
    groups = (photos, calibration, masks, bake, integrate, material, cameras, views, samples, training, evaluation)
    for group in groups:
        group.add_verbs(verbs, common)
    return parser
