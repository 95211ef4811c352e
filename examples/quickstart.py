"""From one photo to a baked normal texture, from start to end, with no file needed.

Presses "Try It": a painted relief and its low-poly copy with UVs, three coloured lights and a camera, the one photo and
its white photo, its normals, and the bake of normals and colours onto the low-poly's UVs. Then relights the result and
compares it with the truth. Leaves a contact sheet in examples/output/quickstart.png.

    python examples/quickstart.py                      (with bpy from PyPI)
    blender -b --python examples/quickstart.py         (with the extension installed)

--model mpsnet, or another model's name, estimates with that model in place of the default; with blender, behind "--".
"""

import argparse
import math
import runpy
import sys
import time
from pathlib import Path

import bpy
import numpy as np

from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.estimate.registry import DEFAULT_MODEL, registered_models
from mpsnet_core.io.image_reading import read_data, read_image
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.scene.normal_map import NormalMap, read_normals
from mpsnet_core.scene.pictures import colour_scale, contact_sheet, cropped, error_picture, photo_picture

OUTPUT = Path(__file__).resolve().parent / "output"
PIXELS, SIZE = 640, 1024
HIGHEST_ERROR = 30.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    names = [entry.name for entry in registered_models()]
    parser.add_argument("--model", choices=names, default=DEFAULT_MODEL, help="estimates the normals")
    start = 1 if bpy.app.module else [*sys.argv, "--"].index("--") + 1
    model = parser.parse_args(sys.argv[start:]).model
    started = time.monotonic()
    OUTPUT.mkdir(exist_ok=True)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    runpy.run_path(str(Path(__file__).with_name("extension.py")))

    step("a painted relief, its photos, the normals by the default network, and its low-poly copy with them")
    bpy.ops.mps.try_it(pixels=PIXELS, samples=32, size=SIZE, output=str(OUTPUT))
    scene = bpy.context.scene
    if model != DEFAULT_MODEL:
        step(f"the normals by {model} in their place")
        bpy.ops.mps.estimate(model=model.upper().replace("-", "_"), output=str(OUTPUT / "normals.png"))
        bpy.ops.mps.bake(size=SIZE, output=str(OUTPUT / "texture.png"))
    detailed, low = (scene.objects[f"Demo {name}"] for name in ("Detailed", "Low Poly"))
    photo, normals, texture = (file_of(step.image) for step in (scene.mps.photo, scene.mps.estimate, scene.mps.bake))

    step("the true normals, and those by equation 2 alone")
    baseline = OUTPUT / "baseline.png"
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(baseline))
    detailed.hide_render, low.hide_render = False, True
    truth = render_truth(OUTPUT / "truth.exr")
    low.hide_render = False

    step("relighting")
    textured = relit(low, OUTPUT / "relit_textured.png")
    original = relit(detailed, OUTPUT / "relit_original.png")
    tree = low.material_slots[0].material.node_tree
    for name in ("MPS Normal", "MPS Albedo"):
        tree.nodes.remove(tree.nodes[name])
    plain = relit(low, OUTPUT / "relit_plain.png")

    estimate = read_normals(normals)
    error = angular_error(estimate.vectors, truth.vectors)
    mask = estimate.mask & truth.mask
    mean = float(error[mask].mean())
    plain_mean = float(angular_error(read_normals(baseline).vectors, truth.vectors)[mask].mean())
    pictures = cropped(
        [
            photo_picture(read_image(photo).pixels, mask),
            estimate.picture(),
            truth.picture(),
            error_picture(error, mask, HIGHEST_ERROR),
            plain,
            textured,
            original,
        ],
        mask,
    )
    titles = [
        "the photo",
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
    write_picture(OUTPUT / "quickstart.png", contact_sheet(tiles, columns=5))
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


def file_of(image: bpy.types.Image) -> Path:
    return Path(bpy.path.abspath(image.filepath))


if __name__ == "__main__":
    main()
