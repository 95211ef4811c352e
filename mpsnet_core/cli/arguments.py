"""An argument parser whose errors are one sentence."""

import argparse
import difflib
import re
from collections.abc import Iterable
from typing import Any, NoReturn, TypeAlias

from mpsnet_core.errors import SettingsError

# How to get what a command requires.
HOW_TO_GET = {
    "--rig": "mpsnet calibrate photo PHOTO -o rig.json makes a rig file, mpsnet calibrate lights a more exact one",
    "--camera": "mpsnet align PHOTO --mesh MESH -o camera.json makes a camera file",
    "--cameras": "photogrammetry makes them, see mpsnet cameras --help",
}


class Parser(argparse.ArgumentParser):
    """Reports bad arguments as bad input: one sentence instead of argparse's usage text."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.sections: dict[str, list[str]] = {}
        # argparse takes -1 for a value, but -1,2,3 for an option.
        self._negative_number_matcher = re.compile(r"-[\d.][\d.,eE+-]*$")

    def error(self, message: str) -> NoReturn:
        needed = [how for flag, how in HOW_TO_GET.items() if re.search(rf"are required:.*{flag}\b", message)]
        raise SettingsError("; ".join([message, *needed, f"see {self.prog} --help"]))

    def format_help(self) -> str:
        """The help, with the commands under their headings if there are any."""
        if not self.sections:
            return super().format_help()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        [verbs] = [action for action in self._actions if isinstance(action, argparse._SubParsersAction)]
        for heading, names in self.sections.items():
            formatter.start_section(heading)
            formatter.add_arguments([one for one in verbs._choices_actions if one.dest in names])
            formatter.end_section()
        formatter.start_section("options")
        formatter.add_arguments([one for one in self._actions if one is not verbs])
        formatter.end_section()
        return formatter.format_help()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        # argparse would hand a verb's unknown arguments to its parent, whose help does not list the verb's options.
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            known = [flag for action in self._actions for flag in action.option_strings]
            self.error(f"unrecognized arguments: {' '.join(unknown)}{_did_you_mean(unknown[0], known)}")
        return parsed, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        # argparse would also list the commands without help, which are for programs.
        if isinstance(action, argparse._SubParsersAction) and value not in action.choices:
            verbs = [verb.dest for verb in action._choices_actions]
            meant = _did_you_mean(value, verbs) or f" (choose from {', '.join(verbs)})"
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{meant}")
        super()._check_value(action, value)

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        # argparse before Python 3.13 loses the value of --open=-- and then stumbles over it.
        if action.option_strings and arg_strings == ["--"]:
            raise argparse.ArgumentError(action, "expected a value, not --")
        return super()._get_values(action, arg_strings)


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question after a word that is not known; "" if nothing is like it."""
    close = difflib.get_close_matches(word, known, 1, 0.7)
    return f"; did you mean {close[0]}?" if close else ""


# What `add_subparsers` returns.
Subparsers: TypeAlias = "argparse._SubParsersAction[Parser]"
