"""From one photo to a baked normal texture, from start to end, with no file needed.

Builds a detailed monkey and its low-poly copy with UVs, puts three coloured lights and a camera around it, renders
the one photo, estimates the normals, bakes them onto the low-poly's UVs, relights the result and compares it with
the truth. Leaves a contact sheet in examples/output/quickstart.png.

    python examples/quickstart.py                      (with bpy from PyPI)
    blender -b --python examples/quickstart.py         (with the extension installed)
"""

import math
import time
from pathlib import Path

import bpy
import numpy as np

from mpsnet_core.evaluation.pictures import (
    colour_scale,
    cropped,
    error_picture,
    normals_picture,
    photo_picture,
    sheet,
)
from mpsnet_core.images import read_data, read_image, write_image
from mpsnet_core.normals import NormalMap, angular_error, read_normals

OUTPUT = Path(__file__).resolve().parent / "output"
PIXELS = 640
HIGHEST_ERROR = 30.0


def main() -> None:
    started = time.monotonic()
    OUTPUT.mkdir(exist_ok=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if not hasattr(bpy.types.Scene, "mps"):
        try:
            import blender_addon
        except ModuleNotFoundError:
            raise SystemExit("this Blender has no MPS-Net extension; install it first, see README") from None
        blender_addon.register()

    step("building a detailed monkey and its low-poly copy")
    detailed, low = build_monkeys()
    low.hide_render = True

    step("adding the rig and rendering the one photo")
    select(detailed)
    bpy.ops.mps.add_rig(slant=30.0, light_type="SUN", projection="ORTHOGRAPHIC")
    photo = OUTPUT / "photo.exr"
    bpy.ops.mps.render_photo(width=PIXELS, height=PIXELS, samples=32, output=str(photo))
    truth = render_truth(OUTPUT / "truth.exr")

    step("estimating the normals, by equation 2 alone and by the default network")
    baseline, normals = OUTPUT / "baseline.png", OUTPUT / "normals.png"
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(baseline))
    bpy.ops.mps.estimate(model="MULTISCALE", output=str(normals))

    step("baking them onto the low-poly's UVs")
    texture = OUTPUT / "texture.png"
    low.hide_render = False
    select(low)
    plain = relit(low, OUTPUT / "relit_plain.png")
    bpy.ops.mps.bake(size=1024, output=str(texture))

    step("relighting")
    textured = relit(low, OUTPUT / "relit_textured.png")
    original = relit(detailed, OUTPUT / "relit_original.png")

    estimate = read_normals(normals)
    error = angular_error(estimate.vectors, truth.vectors)
    mask = estimate.mask & truth.mask
    mean = float(error[mask].mean())
    plain_mean = float(angular_error(read_normals(baseline).vectors, truth.vectors)[mask].mean())
    pictures = cropped(
        [
            photo_picture(read_image(photo).pixels, mask),
            normals_picture(estimate),
            normals_picture(truth),
            error_picture(error, mask, HIGHEST_ERROR),
            plain,
            textured,
            original,
        ],
        mask,
    )
    titles = [
        "the one photo",
        "estimated normals",
        "true normals",
        f"error, mean {mean:.2f}°",
        f"low-poly relit, {len(low.data.polygons)} faces",
        "the same with the texture",
        f"the original relit, {len(detailed.data.polygons)} faces",
    ]
    tiles = list(zip(titles, pictures, strict=True))
    tiles.insert(4, ("degrees", colour_scale(HIGHEST_ERROR, 320)))
    tiles.insert(5, ("baked texture", read_image(texture, encoding="linear").pixels))
    write_image(OUTPUT / "quickstart.png", sheet(tiles, columns=5), bits=8, color_space="sRGB")
    print(f"mean angular error: {mean:.2f}° over {mask.sum()} pixels; of equation 2 alone {plain_mean:.2f}°")
    print(f"contact sheet: {OUTPUT / 'quickstart.png'}  ({time.monotonic() - started:.0f} s)")


def render_truth(path: Path) -> NormalMap:
    """The true normals of the photo's view, from Blender's own Normal pass, turned from the world to the camera."""
    bpy.ops.mps.render_truth(output=str(path))
    world, _ = read_data(path, layer="Normal")
    _, alpha = read_data(path, layer="Combined")
    rotation = np.array(bpy.context.scene.mps.rig.camera.matrix_world.normalized().to_3x3())
    return NormalMap(world @ rotation.astype(np.float32), alpha > 0.5)


def relit(target: bpy.types.Object, path: Path) -> np.ndarray:
    """A picture of `target` alone, by the rig's camera, under one white lamp from the upper right."""
    scene = bpy.data.scenes.new("Relit")
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    lamp.data.energy = 3.5
    lamp.rotation_euler = (math.radians(35), math.radians(50), 0)
    scene.camera = bpy.context.scene.mps.rig.camera
    for thing in (target, lamp, scene.camera):
        scene.collection.objects.link(thing)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 24
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
    bpy.data.objects.remove(lamp)
    picture = read_image(path, encoding="linear")
    return np.where(picture.alpha[..., None] > 0, picture.pixels * picture.alpha[..., None], 0.0).astype(np.float32)


def step(what: str) -> None:
    print(f"-- {what}", flush=True)


def build_monkeys() -> tuple[bpy.types.Object, bpy.types.Object]:
    """A monkey with scales, and its smooth low-poly copy; both share Blender's own UV layout."""
    low = add_monkey("Low", levels=1)
    detailed = add_monkey("Detailed", levels=5)
    displace(detailed, "VORONOI", 0.05, noise_scale=0.16, weight_1=-1.0, weight_2=1.0)
    displace(detailed, "CLOUDS", 0.008, noise_scale=0.05)
    material = bpy.data.materials.new("Matt")
    if not material.node_tree:
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.8, 0.8, 0.8, 1)
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.0
    for monkey in (low, detailed):
        monkey.data.materials.clear()
        monkey.data.materials.append(material if monkey is detailed else material.copy())
    return detailed, low


def add_monkey(name: str, levels: int) -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add(size=2, rotation=(0, 0, 0))
    monkey = bpy.context.object
    monkey.name = name
    subdivision = monkey.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = levels
    bpy.ops.object.modifier_apply(modifier=subdivision.name)
    bpy.ops.object.shade_smooth()
    return monkey


def displace(target: bpy.types.Object, pattern: str, strength: float, **settings: float) -> None:
    texture = bpy.data.textures.new(pattern, pattern)
    for name, value in settings.items():
        setattr(texture, name, value)
    modifier = target.modifiers.new(pattern, "DISPLACE")
    modifier.texture, modifier.strength, modifier.mid_level = texture, strength, 0.5
    select(target)
    bpy.ops.object.modifier_apply(modifier=modifier.name)


def select(target: bpy.types.Object) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    target.select_set(True)
    bpy.context.view_layer.objects.active = target


if __name__ == "__main__":
    main()
