"""How the command line takes its arguments."""

import argparse
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    from mpsnet_core.capture.correction import Correction
    from mpsnet_core.estimate import Estimator


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Says an option's default, where it has one that says something."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        silent_default = action.default in (None, argparse.SUPPRESS, False, "")
        return action.help if silent_default else super()._get_help_string(action)


class Parser(argparse.ArgumentParser):
    """Bad arguments are bad input: one sentence instead of argparse's usage text."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        # argparse before Python 3.13 loses the value of --open=-- and then stumbles over it.
        if action.option_strings and arg_strings == ["--"]:
            raise argparse.ArgumentError(action, "expected a value, not --")
        return super()._get_values(action, arg_strings)


# What `add_subparsers` gives: the place where verbs are added.
Verbs = argparse._SubParsersAction


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How a photo is read: its encoding and layer, dark frame and flat field."""
    parser.add_argument("--encoding", default="auto", help="auto, linear or srgb: how the photo's values are meant")
    parser.add_argument("--layer", help="layer of a multi-layer EXR")
    parser.add_argument(
        "--dark", help="photo(s) with the three lights off, to take off: a file, or a folder or pattern to average"
    )
    parser.add_argument(
        "--flat",
        help="photo(s) of an even white card in the object's place, to divide by: as --dark; not with near lights",
    )
    parser.add_argument(
        "--flat-smooth", type=int, default=0, metavar="PIXELS", help="leave out the card's grain, finer than so many"
    )


def add_network(parser: argparse.ArgumentParser, model: str = "multiscale") -> None:
    """Which model estimates the normals, and how networks run. model: what is said to be taken unless told."""
    parser.add_argument("--model", help=f"a name of `mpsnet models` or an .onnx file; {model} unless given")
    parser.add_argument(
        "--provider", default="cpu", choices=("cpu", "cuda", "directml", "coreml"), help="what runs networks"
    )
    parser.add_argument("--threads", type=int, default=0, help="CPU threads for networks, 0 for all")
    parser.add_argument("--tile", type=int, help="tile side in pixels for networks (default: 448)")


def parse_estimator(
    options: argparse.Namespace, model: str | None = None, passes: Literal[1, 3] | None = None
) -> "Estimator":
    """The estimator that options of :func:`add_network` ask for.

    model: where they name none; the default model. passes: as :class:`mpsnet_core.estimate.Estimator` takes them.
    """
    from mpsnet_core.estimate import Estimator
    from mpsnet_core.estimate.registry import DEFAULT_MODEL, DEFAULT_TILE

    return Estimator(
        options.model or model or DEFAULT_MODEL,
        passes=passes,
        provider=options.provider,
        threads=options.threads,
        tile=DEFAULT_TILE if options.tile is None else options.tile,
    )


def parse_correction(options: argparse.Namespace) -> "Correction | None":
    """Dark frame and flat field as :func:`add_reading` takes them, None where neither is given.

    Raises InputError as `read_correction` does, and where the flat field to smooth is lacking.
    """
    from mpsnet_core.capture.correction import read_correction

    if options.flat_smooth and options.flat is None:
        raise InputError("--flat-smooth smooths the flat field; give --flat, or leave it out")
    if options.dark is None and options.flat is None:
        return None
    return read_correction(
        options.dark, options.flat, encoding=options.encoding, layer=options.layer, smooth=options.flat_smooth
    )
