"""Run by a Python of its own: open .blend files and render what their camera sees of one object, as OpenEXR.

Arguments: the object's name; then FILE.blend=PICTURE.exr, or FILE.blend=PICTURE.exr=flip to turn each normal texture's
green over on its way into the Normal Map node.
"""

import sys

import bpy


def flip_green(tree: "bpy.types.NodeTree") -> None:
    for node in [node for node in tree.nodes if node.type == "NORMAL_MAP" and node.inputs["Color"].links]:
        turn = tree.nodes.new("ShaderNodeVectorMath")
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        tree.links.new(node.inputs["Color"].links[0].from_socket, turn.inputs[0])
        tree.links.new(turn.outputs["Vector"], node.inputs["Color"])


def main(name: str, *jobs: str) -> None:
    for job in jobs:
        blend, picture, *flip = job.split("=")
        bpy.ops.wm.open_mainfile(filepath=blend)
        shown = bpy.data.objects[name]
        for obj in bpy.data.objects:
            if obj.type == "MESH":
                obj.hide_render = obj != shown
        if flip:
            flip_green(shown.material_slots[0].material.node_tree)
        bpy.context.scene.render.filepath = picture
        bpy.ops.render.render(write_still=True)


main(*sys.argv[1:])
