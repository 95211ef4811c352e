"""Where the packages that the extension needs come from, when imported in Blender."""

import importlib
import json
import sys
from pathlib import Path

import bpy

report = sys.argv[sys.argv.index("--") + 1]
packages = ("mpsnet_core", "numpy", "onnxruntime", "OpenImageIO", "trimesh", "embreex")
found = {name: importlib.import_module(name).__file__ for name in packages}
Path(report).write_text(json.dumps({**found, "operators": dir(bpy.ops.mps)}), encoding="utf-8")
