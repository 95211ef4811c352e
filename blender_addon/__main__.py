"""``python -m blender_addon [--online-mode] [SCENE.blend] VERB``: commands.py with pip's bpy instead of Blender."""

import atexit
import os
import shutil
import sys
from pathlib import Path

code = 1  # until run() returns


@atexit.register  # before bpy is imported, so that it runs after what bpy registers
def leave() -> None:
    """Exit without the destructors of the bpy wheel: those of 4.5 hang if a file had linked libraries."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


import bpy  # noqa: E402

import blender_addon  # noqa: E402
from blender_addon.child_process.trust import preferences_trust  # noqa: E402
from blender_addon.commands import COMMAND, main  # noqa: E402
from blender_addon.errors import operator_report  # noqa: E402
from mpsnet_core.cli import EXIT_BAD_INPUT, EXIT_UNFORESEEN  # noqa: E402
from mpsnet_core.io.crash_log import describe_unexpected_error  # noqa: E402


def run(arguments: list[str]) -> int:
    """Register the add-on, open the file if one is given, and run the verb. Returns the exit code."""
    blender_addon.register()
    if arguments[:1] == ["--online-mode"]:  # like Blender's own option, overrides its preferences
        arguments.pop(0)
        bpy.context.preferences.system.use_online_access = True
    if arguments and arguments[0].endswith(".blend"):
        try:
            # Blender would look from $PWD. resolve() replaces the letter of a network drive.
            path = os.path.abspath(arguments.pop(0))  # noqa: PTH100
            bpy.ops.wm.open_mainfile(filepath=path, use_scripts=preferences_trust(path))
        except RuntimeError as error:
            sys.stderr.write(f"{COMMAND}: {operator_report(error)}; check the path\n")
            return EXIT_BAD_INPUT
    return main(arguments)


try:
    code = run(sys.argv[1:])
except Exception as error:  # noqa: BLE001
    code = EXIT_UNFORESEEN
    sys.stderr.write(f"{COMMAND}: {describe_unexpected_error(error)}\n")
except SystemExit as ended:  # argparse's
    code = ended.code if isinstance(ended.code, int) else 0 if ended.code is None else 1
    raise
finally:
    scratch = Path(bpy.app.tempdir)  # Blender's own for this session, unless it could not make one
    if scratch.name.startswith("blender_"):
        shutil.rmtree(scratch, ignore_errors=True)
