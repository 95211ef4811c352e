"""How the command line takes its arguments."""

import argparse
from typing import TYPE_CHECKING, NoReturn

from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    from mpsnet_core.correction import Correction


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Says an option's default, where it has one that says something."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        silent_default = action.default in (None, argparse.SUPPRESS, False, "")
        return action.help if silent_default else super()._get_help_string(action)


class Parser(argparse.ArgumentParser):
    """Bad arguments are bad input: one sentence instead of argparse's usage text."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")


# What `add_subparsers` gives: the place where verbs are added.
Verbs = argparse._SubParsersAction


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How a photo is read: its encoding and layer, dark frame and flat field."""
    parser.add_argument("--encoding", default="auto", help="auto, linear or srgb: how the photo's values are meant")
    parser.add_argument("--layer", help="layer of a multi-layer EXR")
    parser.add_argument(
        "--dark", help="photo(s) with the three lights off, to take off: a file, or a folder or pattern to average"
    )
    parser.add_argument("--flat", help="photo(s) of an even white card in the object's place, to divide by: as --dark")
    parser.add_argument(
        "--flat-smooth", type=int, default=0, metavar="PIXELS", help="leave out the card's grain, finer than so many"
    )


def asked_correction(options: argparse.Namespace) -> "Correction | None":
    """Dark frame and flat field as :func:`add_reading` takes them, None where neither is given."""
    from mpsnet_core.correction import read_correction

    if options.dark is None and options.flat is None:
        return None
    return read_correction(options.dark, options.flat, encoding=options.encoding, smooth=options.flat_smooth)


def read_files(options: argparse.Namespace) -> list[str]:
    """The files that mask, dark frame and flat field are read from, which no result may overwrite."""
    mask = (options.mask or "").removeprefix("background:")
    return [file for file in (mask, options.dark, options.flat) if file]
