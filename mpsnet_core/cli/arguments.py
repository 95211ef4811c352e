"""An argument parser whose errors are one sentence."""

import argparse
import difflib
import re
from collections.abc import Iterable
from typing import Any, NoReturn, TypeAlias

from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import SettingsError
from mpsnet_core.operation import Operation, Setting, settings

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


# --- the command line of an operation, generated from its description -------------------------------------------------


# Commands of two words, by the first word: its help, and the placeholder for the second word.
GROUPS = {
    "calibrate": ("find where the lights are and how their colours mix, by a ball, a mesh or any photo", "WHAT"),
    "evaluate": ("measure models against known normals", "TEST"),
}


def add_operation(subparsers: Subparsers, common: Parser, kind: type[Operation], example: str = "") -> None:
    """Add the command of an operation, with a positional argument or a flag for each option.

    example: a command line that the help shows at its end.
    """
    group, _, name = kind.command.rpartition(" ")
    facts: dict[str, Any] = {"help": kind.help()[:1].lower() + kind.help()[1:]} if kind.listed else {}
    if example:
        facts["epilog"] = f"example: {example}"
    place = _group(subparsers, group) if group else subparsers
    parser = place.add_parser(name, parents=[common], **facts)
    groups: dict[str, argparse._ActionsContainer] = {"": parser}
    for setting in settings(kind):
        heading = "" if setting.option.positional else setting.heading
        if heading not in groups:
            groups[heading] = parser.add_argument_group(heading)
        _add(groups[heading], setting)

    def verb(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
        given = {setting.name: getattr(options, setting.name) for setting in settings(kind)}
        # argparse would append to a default list.
        given = {name: value for name, value in given.items() if value is not None}
        return kind(**given).run(reporter.progress).facts()

    parser.set_defaults(verb=verb)


def _group(subparsers: Subparsers, name: str) -> Subparsers:
    """The subparsers of the commands whose first word is `name`, added if they are missing."""
    if name not in subparsers.choices:
        words, metavar = GROUPS[name]
        subparsers.add_parser(name, help=words).add_subparsers(metavar=metavar, required=True)
    [found] = [action for action in subparsers.choices[name]._actions if isinstance(action, argparse._SubParsersAction)]
    return found


def _add(parser: argparse._ActionsContainer, setting: Setting) -> None:
    described = setting.option
    facts: dict[str, Any] = {"help": _help(setting)}
    if setting.kind is bool:
        parser.add_argument(*setting.flags, action="store_true", **facts)
        return
    if setting.kind is not str:
        facts["type"] = setting.kind
    if described.metavar:
        facts["metavar"] = described.metavar
    if described.positional:
        if setting.several:
            facts["nargs"] = "+" if setting.required else "*"
        elif not setting.required:
            facts["nargs"] = "?"
        parser.add_argument(setting.name, **facts)
        return
    if setting.several:
        facts["action"] = "append"
    if setting.required:
        facts["required"] = True
    else:
        facts["default"] = None if setting.several else setting.default
    parser.add_argument(*setting.flags, **facts)


def _help(setting: Setting) -> str:
    if not setting.option.help:
        return argparse.SUPPRESS
    return setting.option.words(setting.default, setting.several).replace("%", "%%")
