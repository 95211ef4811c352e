"""``python -m blender_addon [SCENE.blend] VERB``: the command line of commands.py, with pip's bpy for a Blender."""

import sys

import bpy

import blender_addon
from blender_addon.commands import COMMAND, EXIT_BAD_INPUT, main

arguments = sys.argv[1:]
blender_addon.register()
if arguments and arguments[0].endswith(".blend"):
    try:
        bpy.ops.wm.open_mainfile(filepath=arguments.pop(0))
    except RuntimeError as error:
        sentence = " ".join(str(error).split()).removeprefix("Error: ")
        print(f"{COMMAND}: {sentence}; check the path", file=sys.stderr)  # noqa: T201
        sys.exit(EXIT_BAD_INPUT)
sys.exit(main(arguments))
