"""``python -m blender_addon [--online-mode] [SCENE.blend] VERB``: commands.py with pip's bpy for a Blender."""

import sys
from pathlib import Path

import bpy

import blender_addon
from blender_addon.commands import COMMAND, EXIT_BAD_INPUT, main
from blender_addon.trust import preferences_trust

arguments = sys.argv[1:]
blender_addon.register()
if arguments[:1] == ["--online-mode"]:  # as Blender's own, whose preferences say otherwise
    arguments.pop(0)
    bpy.context.preferences.system.use_online_access = True
if arguments and arguments[0].endswith(".blend"):
    try:
        path = arguments.pop(0)
        bpy.ops.wm.open_mainfile(filepath=path, use_scripts=preferences_trust(str(Path(path).resolve())))
    except RuntimeError as error:
        sentence = " ".join(str(error).split()).removeprefix("Error: ")
        print(f"{COMMAND}: {sentence}; check the path", file=sys.stderr)  # noqa: T201
        sys.exit(EXIT_BAD_INPUT)
sys.exit(main(arguments))
