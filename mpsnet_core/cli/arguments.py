"""How the command line parses its arguments: errors are one sentence, and the help shows defaults that matter."""

import argparse
from typing import Any, NoReturn, TypeAlias

from mpsnet_core.errors import InputError


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Shows an option's default, where it is not empty."""

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


# What `add_subparsers` returns: the place where verbs are added.
Verbs: TypeAlias = "argparse._SubParsersAction[Parser]"
