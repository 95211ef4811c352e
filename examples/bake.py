"""Bake estimated normals onto a low-poly copy, and render it with them.

    blender -b --python examples/bake.py                   onto a coarse monkey, with what estimate.py left or makes now
    blender -b scene.blend --python examples/bake.py       onto the active object of your own scene with its estimate
    python examples/bake.py  with `pip install -e '.[blender]'` in a copy of the repository

Leaves output/texture.png, the tangent-space texture, and output/relit.png, the low-poly under the rig's lights with it.
"""

import math
import runpy
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
OUTPUT = HERE / "output"


def low_poly(original):
    """A copy without subdivision, unwrapped anew, where the original stands; the original is hidden."""
    copy = original.copy()
    copy.data = original.data.copy()
    copy.name = "Low Poly"
    copy.modifiers.clear()
    bpy.context.scene.collection.objects.link(copy)
    bpy.ops.object.select_all(action="DESELECT")
    copy.select_set(True)
    bpy.context.view_layer.objects.active = copy
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    original.hide_render = True
    return copy


def relit(path):
    """A picture by the rig's camera under one white lamp from the upper right, instead of the rig's lights."""
    scene = bpy.context.scene
    for light in scene.mps.rig.lights:
        light.object.hide_render = True
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    lamp.data.energy, lamp.rotation_euler = 3.5, (math.radians(35), math.radians(50), 0)
    scene.collection.objects.link(lamp)
    scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 32, True
    scene.camera = scene.mps.rig.camera
    scene.render.resolution_x, scene.render.resolution_y = scene.mps.photo.width, scene.mps.photo.height
    scene.render.resolution_percentage = 100
    if bpy.app.version >= (5, 0):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "PNG"
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


runpy.run_path(str(HERE / "extension.py"))

own_scene = bool(bpy.data.filepath)
if not own_scene:
    if not (OUTPUT / "normals.blend").exists():
        runpy.run_path(str(HERE / "estimate.py"))
    bpy.ops.wm.open_mainfile(filepath=str(OUTPUT / "normals.blend"))

OUTPUT.mkdir(exist_ok=True)
target = bpy.context.object if own_scene else low_poly(bpy.data.objects["Suzanne"])
bpy.ops.mps.bake(
    target=target.name, size=1024, space="TANGENT", convention="OPENGL", output=str(OUTPUT / "texture.png")
)
relit(OUTPUT / "relit.png")
print(f"the texture is {OUTPUT / 'texture.png'}, the low-poly with it {OUTPUT / 'relit.png'}")
