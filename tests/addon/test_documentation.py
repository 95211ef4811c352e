"""The documentation's commands for Blender are ones that there are."""

import pytest
from documentation import PROJECT, WRITTEN, commands

from blender_addon.commands import _parser


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: str(page.relative_to(PROJECT)))
def test_commands_of_blender_are_ones_that_there_are(page):
    calls = [call[call.index("--command") + 2 :] for call in commands(page, "blender") if "--command" in call]
    calls += [call[2:] for call in commands(page, "python") if call[:2] == ["-m", "blender_addon"]]
    for arguments in calls:
        if arguments[0] not in {"install-file", "server-generate"} and "--help" not in arguments:
            _parser().parse_args(arguments)
