"""``python -m blender_addon [SCENE.blend] VERB``: the command line of commands.py, with pip's bpy for a Blender."""

import sys

import bpy

import blender_addon
from blender_addon.commands import main

arguments = sys.argv[1:]
blender_addon.register()
if arguments and arguments[0].endswith(".blend"):
    bpy.ops.wm.open_mainfile(filepath=arguments.pop(0))
sys.exit(main(arguments))
