"""The command line of an operation, generated from its description."""

import argparse
from typing import Any

from mpsnet_core.cli.arguments import Parser, Subparsers
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.operation import Operation, Setting, settings

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
