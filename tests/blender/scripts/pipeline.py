"""The four steps through bpy.ops.mps.

Arguments: the report to write, a .blend file with an object "Sphere", and the folder for the results.
"""

import json
import sys
from pathlib import Path

import bpy

report, scene, folder = map(Path, sys.argv[sys.argv.index("--") + 1 :])
bpy.ops.wm.open_mainfile(filepath=str(scene))
sphere = bpy.data.objects["Sphere"]

bpy.ops.mps.add_rig()
bpy.ops.mps.render_photo(width=160, height=160, samples=32, output=str(folder / "photo.exr"))
bpy.ops.mps.estimate(model="LAMBERTIAN", mask="AUTO", output=str(folder / "normals.png"))
bpy.ops.mps.bake(target="Sphere", size=256, output=str(folder / "texture.png"))

bpy.ops.mps.open_photo(filepath=str(folder / "photo.exr"))

nodes = sphere.material_slots[0].material.node_tree.nodes
report.write_text(
    json.dumps(
        {
            "openimageio": sys.modules["OpenImageIO"].__file__,
            "worn": [node.image.filepath for node in nodes if node.type == "TEX_IMAGE"],
        }
    ),
    encoding="utf-8",
)
