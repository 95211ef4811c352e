"""A scene with one smooth, matt sphere with UVs, saved to the .blend file that is the argument after the report."""

import json
import sys
from pathlib import Path

import bpy

report, scene = sys.argv[sys.argv.index("--") + 1 :]
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)
bpy.ops.object.shade_smooth()
matt = bpy.data.materials.new("Matt")
matt.use_nodes = True
tree = matt.node_tree
output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs["BSDF"], output.inputs["Surface"])
bpy.context.object.data.materials.append(matt)
bpy.ops.wm.save_as_mainfile(filepath=scene)
Path(report).write_text(json.dumps(bpy.data.objects.keys()), encoding="utf-8")
