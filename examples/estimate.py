"""Estimate the normals that a photo shows.

    blender -b --python examples/estimate.py                   of the photo that render_photo.py left, or makes now
    blender -b scene.blend --python examples/estimate.py       of the photo in your own scene
    python examples/estimate.py  with `pip install -e '.[blender]'` in a copy of the repository

Leaves output/normals.png: red is right, green is up, blue faces the camera.
"""

import runpy
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
OUTPUT = HERE / "output"

runpy.run_path(str(HERE / "extension.py"))

if not bpy.data.filepath:
    if not (OUTPUT / "scene.blend").exists():
        runpy.run_path(str(HERE / "render_photo.py"))
    bpy.ops.wm.open_mainfile(filepath=str(OUTPUT / "scene.blend"))

OUTPUT.mkdir(exist_ok=True)
bpy.ops.mps.estimate(mask="ALPHA", output=str(OUTPUT / "normals.png"))
bpy.ops.wm.save_as_mainfile(filepath=str(OUTPUT / "normals.blend"), copy=True)
print(f"the normal map is {OUTPUT / 'normals.png'}")
