"""Makes the statue of the docs' films and pictures, carved and painted in rings, and its plain mesh."""

import bpy
import numpy as np

PAINT = (0.72, 0.6, 0.42), (0.5, 0.16, 0.08), (0.72, 0.6, 0.42), (0.12, 0.25, 0.32)
EYE, RINGS, DEEP = (0.35, -0.72, 0.24), 9.0, 0.011  # where they begin, how many are in a unit, and how deep
POSE = 0.2, -0.15, 0.5


def monkey(name, levels):
    bpy.ops.mesh.primitive_monkey_add(rotation=POSE)
    obj = bpy.context.object
    obj.name = name
    obj.modifiers.new("Smooth", "SUBSURF").levels = levels
    bpy.ops.object.modifier_apply(modifier="Smooth")
    bpy.ops.object.shade_smooth()
    return obj


def carve(mesh):
    points, normals = np.empty((2, len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    mesh.vertices.foreach_get("normal", normals.ravel())
    ring = RINGS * np.linalg.norm(np.c_[abs(points[:, 0]), points[:, 1:]] - EYE, axis=1)
    mesh.vertices.foreach_set("co", (points + DEEP * np.cos(2 * np.pi * ring)[:, None] * normals).ravel())
    colours = np.insert(np.array(PAINT)[(ring + 0.5).astype(int) % len(PAINT)], 3, 1, axis=1)
    paint = mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    paint.data.foreach_set("color", colours.astype(np.float32).ravel())


def painted():
    material = bpy.data.materials.new("Paint")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    links.new(nodes.new("ShaderNodeVertexColor").outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0.2
    return material


def photographed(path, size):
    """Its photo and white photo, taken from the front with a little room around it."""
    bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=60)
    bpy.ops.mps.render_photo(width=size, height=size, samples=8, white=True, output=path)
    return bpy.context.scene.mps.rig.camera


bpy.data.batch_remove(bpy.data.objects)
plain, carved = monkey("statue", 2), monkey("Carved", 5)
carve(carved.data)
carved.data.materials.append(painted())
plain.hide_render = True
