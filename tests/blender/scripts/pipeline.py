"""The four steps through bpy.ops.mps, and what a script is told where one cannot be done.

Arguments: the report to write, a .blend file with an object "Sphere", and the folder for the results.
"""

import json
import sys
from pathlib import Path

import bpy

report, scene, folder = map(Path, sys.argv[sys.argv.index("--") + 1 :])
bpy.ops.wm.open_mainfile(filepath=str(scene))
sphere = bpy.data.objects["Sphere"]
errors = {}


def refused(step, operator, **settings):
    """Note what the RuntimeError of a step that cannot be done says."""
    try:
        operator(**settings)
    except RuntimeError as error:
        errors[step] = str(error)


refused("estimate without photo", bpy.ops.mps.estimate)
sphere.select_set(False)
refused("rig around nothing", bpy.ops.mps.add_rig)
sphere.select_set(True)

bpy.ops.mps.add_rig()
refused("photo that does not exist", bpy.ops.mps.open_photo, filepath=str(folder / "none.png"))
bpy.ops.mps.render_photo(width=160, height=160, samples=32, output=str(folder / "photo.exr"))
refused("mask that does not exist", bpy.ops.mps.estimate, mask="FILE", mask_file=str(folder / "none.png"))
bpy.ops.mps.estimate(model="LAMBERTIAN", mask="AUTO", output=str(folder / "normals.png"))
bpy.ops.mesh.primitive_cube_add(calc_uvs=False)
plain = bpy.context.object
refused("bake without UVs", bpy.ops.mps.bake, target=plain.name)
bpy.data.objects.remove(plain)
bpy.ops.mps.bake(target="Sphere", size=256, output=str(folder / "texture.png"))

bpy.ops.mps.open_photo(filepath=str(folder / "photo.exr"))

nodes = sphere.material_slots[0].material.node_tree.nodes
report.write_text(
    json.dumps(
        {
            "errors": errors,
            "left": sorted(path.name for path in folder.iterdir()),
            "openimageio": sys.modules["OpenImageIO"].__file__,
            "worn": [node.image.filepath for node in nodes if node.type == "TEX_IMAGE"],
        }
    ),
    encoding="utf-8",
)
