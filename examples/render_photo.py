"""Render the one photo: a monkey under a red, a green and a blue light.

    blender -b --python examples/render_photo.py                 with the extension installed
    blender -b scene.blend --python examples/render_photo.py     of the active object of your own scene
    python examples/render_photo.py  with `pip install -e '.[blender]'` in a copy of the repository

Leaves output/photo.exr (linear), output/photo.png (to look at) and output/scene.blend for the next examples.
"""

import runpy
from pathlib import Path

import bpy

OUTPUT = Path(__file__).resolve().parent / "output"


def add_monkey():
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mesh.primitive_monkey_add(rotation=(-0.1, 0, 0.3))
    monkey = bpy.context.object
    monkey.modifiers.new("Subdivision", "SUBSURF").render_levels = 3
    bpy.ops.object.shade_smooth()
    matte = bpy.data.materials.new("Matte")
    if bpy.app.version < (5, 0):
        matte.use_nodes = True
    matte.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0
    monkey.data.materials.append(matte)


def save_picture(path):
    """What the photo looks like on a screen, as a PNG."""
    scene = bpy.context.scene
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode = "PNG", "RGBA"
    scene.view_settings.view_transform = "Standard"
    scene.mps.photo.image.save_render(str(path), scene=scene)


runpy.run_path(str(Path(__file__).with_name("extension.py")))

OUTPUT.mkdir(exist_ok=True)
if not bpy.data.filepath:
    add_monkey()
bpy.context.object.select_set(True)
bpy.ops.mps.add_rig(slant=30, projection="ORTHOGRAPHIC")
bpy.ops.mps.render_photo(width=512, height=512, samples=64, output=str(OUTPUT / "photo.exr"))
save_picture(OUTPUT / "photo.png")
bpy.ops.wm.save_as_mainfile(filepath=str(OUTPUT / "scene.blend"), copy=True)
print(f"the photo is {OUTPUT / 'photo.png'}")
