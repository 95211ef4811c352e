"""Render the photos of the guided tour, for those who have no rig yet: what a camera sees on a real table.

    python examples/practice_photos.py  with `pip install -e '.[blender]'` in a copy of the repository
    blender -b --python examples/practice_photos.py      with the extension installed

Leaves in practice/, in the folder that it is run in: a mirror ball, a grey ball and a figure, each under the same three
lights, a piece of plaster lying flat, a figure's low-poly mesh with UVs, and the cameras. The lights' colours leak into
one another, as those of real LEDs do. The camera looks along Blender's +Y; the mesh is in the same world. It takes some
minutes, and logs how far it is; smaller photos, --pixels 512 --samples 8, take less. In Blender they stand after a --.
"""

import argparse
import logging
import runpy
import sys
from pathlib import Path

import bpy

from mpsnet_core.progress import can_show_bar, shown_progress

PRACTICE = Path.cwd() / "practice"
# How red, green and blue the camera sees each of the three lights.
COLOURS = ((1.0, 0.12, 0.02), (0.1, 1.0, 0.14), (0.03, 0.15, 1.0))
PHOTOS = ("photo", "ball", "grey", "plaster")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pixels", type=int, default=768, help="the photos' width and height (default: %(default)s)")
    parser.add_argument("--samples", type=int, default=24, help="Cycles samples a pixel (default: %(default)s)")
    start = 1 if bpy.app.module else [*sys.argv, "--"].index("--") + 1
    options = parser.parse_args(sys.argv[start:])
    PRACTICE.mkdir(exist_ok=True)
    # The operators report their progress there.
    logging.basicConfig(level=logging.WARNING if can_show_bar() else logging.INFO, format="%(message)s")
    progress = shown_progress()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    runpy.run_path(str(Path(__file__).with_name("extension.py")))

    figure = add_monkey(levels=4)
    for pattern, strength, scale in (("VORONOI", 0.05, 0.16), ("CLOUDS", 0.01, 0.05)):
        displace(figure, pattern, strength, scale)
    clothe(figure, colour=(0.62, 0.5, 0.4))
    low = add_monkey(levels=1)
    clothe(low, colour=(0.62, 0.5, 0.4))
    bpy.ops.wm.obj_export(
        filepath=str(PRACTICE / "figure.obj"), export_selected_objects=True, forward_axis="Y", up_axis="Z"
    )
    low.hide_render = True
    add_rig(figure, projection="PERSPECTIVE", focal_length=85)
    photograph("photo", figure, options, progress)

    ball = add_ball()
    clothe(ball, colour=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.05)
    photograph("ball", ball, options, progress)
    clothe(ball, colour=(0.5, 0.5, 0.5))
    photograph("grey", ball, options, progress)

    plaster = add_plaster()
    clothe(plaster, colour=(0.55, 0.5, 0.42))
    add_rig(plaster, projection="ORTHOGRAPHIC", view="TOP")
    bpy.context.scene.mps.rig.camera.data.ortho_scale = 1.9  # it fills the picture
    photograph("plaster", plaster, options, progress)
    progress.close()
    print(f"practice photos are in {PRACTICE}")


def add_rig(target, **settings):
    select(target)
    bpy.ops.mps.add_rig(slant=33, tilt=85, **settings)
    for light, colour in zip(bpy.context.scene.mps.rig.lights, COLOURS, strict=True):
        light.object.data.color = colour


def add_monkey(levels):
    bpy.ops.mesh.primitive_monkey_add(rotation=(-0.1, 0, 0.3))
    monkey = bpy.context.object
    monkey.modifiers.new("Subdivision", "SUBSURF").levels = levels
    bpy.ops.object.modifier_apply(modifier="Subdivision")
    bpy.ops.object.shade_smooth()
    return monkey


def add_ball():
    bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=1.0)
    bpy.ops.object.shade_smooth()
    return bpy.context.object


def add_plaster():
    """A square of 2 units, grained by cells of several sizes."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=700, y_subdivisions=700, size=2)
    plaster = bpy.context.object
    bpy.ops.object.shade_smooth()
    for pattern, strength, scale in (("VORONOI", 0.05, 0.12), ("VORONOI", 0.02, 0.05), ("CLOUDS", 0.01, 0.02)):
        displace(plaster, pattern, strength, scale)
    return plaster


def displace(target, pattern, strength, scale):
    texture = bpy.data.textures.new(pattern, pattern)
    texture.noise_scale = scale
    modifier = target.modifiers.new(pattern, "DISPLACE")
    modifier.texture, modifier.strength, modifier.mid_level = texture, strength, 0.5
    select(target)
    bpy.ops.object.modifier_apply(modifier=modifier.name)


def clothe(target, colour, metallic=0.0, roughness=1.0):
    material = bpy.data.materials.new(target.name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*colour, 1)
    inputs["Metallic"].default_value, inputs["Roughness"].default_value = metallic, roughness
    inputs["Specular IOR Level"].default_value = 0.0
    target.data.materials.clear()
    target.data.materials.append(material)


def select(target):
    bpy.ops.object.select_all(action="DESELECT")
    target.select_set(True)
    bpy.context.view_layer.objects.active = target


def photograph(name, target, options, progress):
    """A photo of `target` alone. Its rig file is the answer to what the tour measures, so it goes."""
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            thing.hide_render = thing != target
    number = PHOTOS.index(name)
    progress(number / len(PHOTOS), f"{name}.exr, {number + 1} of {len(PHOTOS)}")
    size = {"width": options.pixels, "height": options.pixels, "samples": options.samples}
    bpy.ops.mps.render_photo(**size, output=str(PRACTICE / f"{name}.exr"))
    (PRACTICE / f"{name}.rig.json").unlink()


if __name__ == "__main__":
    main()
