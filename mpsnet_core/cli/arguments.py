"""An argument parser whose errors are one sentence."""

import argparse
import re
from typing import Any, NoReturn, TypeAlias

from mpsnet_core.errors import SettingsError


class Parser(argparse.ArgumentParser):
    """Reports bad arguments as bad input: one sentence instead of argparse's usage text."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        # argparse takes -1 for a value, but -1,2,3 for an option.
        self._negative_number_matcher = re.compile(r"-[\d.][\d.,eE+-]*$")

    def error(self, message: str) -> NoReturn:
        raise SettingsError(f"{message}; see {self.prog} --help")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        # argparse would hand a verb's unknown arguments to its parent, whose help does not list the verb's options.
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return parsed, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        # argparse would also list the commands without help, which are for programs.
        if isinstance(action, argparse._SubParsersAction) and value not in action.choices:
            listed = ", ".join(verb.dest for verb in action._choices_actions)
            raise argparse.ArgumentError(action, f"invalid choice: {value!r} (choose from {listed})")
        super()._check_value(action, value)

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        # argparse before Python 3.13 loses the value of --open=-- and then stumbles over it.
        if action.option_strings and arg_strings == ["--"]:
            raise argparse.ArgumentError(action, "expected a value, not --")
        return super()._get_values(action, arg_strings)


# What `add_subparsers` returns.
Subparsers: TypeAlias = "argparse._SubParsersAction[Parser]"
