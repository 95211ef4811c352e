"""How a displaced low poly looks beside its high poly, and beside the same with its normal map alone.

    python tests/benchmarks/displacement.py [--faces 6000] [--size 1024] [--normals estimated]

Needs pip's bpy and the statues in MPSNET_TEST_DATA/meshes/scans. Each is decimated, unwrapped by Smart UV Project,
and baked onto from one view of the high poly: its true normals, or those estimated from a photo under the rig. Cycles
renders both under a light that the rig does not have, from two sides: the photo's, and 40° around from there, where a
part of what is seen was not baked. Differences are in hundredths of full white, over all pixels of either object:
their mean, and what one in a hundred exceeds. Ends with 1 where a displaced object differs more than with its normal
map alone.
"""

import argparse
import math
import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix
from quiet import quiet

import blender_addon

STATUES = ("threedscans_Athena", "threedscans_Hermes", "odedstein_lionstatue", "threedscans_ShepherdBoy")
RESOLUTION = 512
PHOTO = 768
AROUND = 40
METHODS = ("MATERIAL", "MODIFIER")


def pair(file: Path, faces: int) -> tuple[bpy.types.Object, bpy.types.Object]:
    """The high poly, and its decimated copy with UVs."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.ply_import(filepath=str(file), forward_axis="Y", up_axis="Z")
    high = bpy.context.object
    high.name = "High"
    # Decimation copes with scans' doubled and loose vertices badly.
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.remove_doubles(threshold=1e-6)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.shade_smooth()
    material = bpy.data.materials.new("Grey")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.8, 0.8, 0.8, 1)
    shader.inputs["Specular IOR Level"].default_value = 0
    high.data.materials.clear()
    high.data.materials.append(material)
    low = high.copy()
    low.data, low.name = high.data.copy(), "Low"
    low.data.materials[0] = material.copy()
    bpy.context.collection.objects.link(low)
    choose(low)
    modifier = low.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio = faces / len(low.data.polygons)
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.002)
    bpy.ops.object.mode_set(mode="OBJECT")
    return high, low


def choose(obj: bpy.types.Object) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj


def bake(high: bpy.types.Object, low: bpy.types.Object, folder: Path, size: int, normals: str) -> None:
    """The low poly wears what one view shows of the high poly."""
    scene = bpy.context.scene
    choose(high)
    bpy.ops.mps.add_rig()
    low.hide_render = True
    bpy.ops.mps.render_photo(width=PHOTO, height=PHOTO, samples=16, output=str(folder / "photo.exr"))
    if normals == "estimated":
        bpy.ops.mps.estimate(output=str(folder / "normals.exr"))
    else:
        scene.mps.estimate.image = true_normals(high, folder)
    high.hide_render, low.hide_render = True, False
    bpy.ops.mps.bake(target=low.name, size=size, output=str(folder / "low_normal.png"))


def true_normals(high: bpy.types.Object, folder: Path) -> bpy.types.Image:
    """The high poly's smooth normals in camera space, as the rig's camera sees them."""
    own = high.data.materials[0]
    material = high.data.materials[0] = bpy.data.materials.new("Normals")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    add = tree.nodes.new
    geometry, turn, shift = add("ShaderNodeNewGeometry"), add("ShaderNodeVectorTransform"), add("ShaderNodeVectorMath")
    turn.vector_type, turn.convert_from, turn.convert_to = "NORMAL", "WORLD", "CAMERA"
    shift.operation = "MULTIPLY_ADD"
    # Blender's camera space has z into the picture.
    shift.inputs[1].default_value, shift.inputs[2].default_value = (0.5, 0.5, -0.5), (0.5, 0.5, 0.5)
    emission, output = add("ShaderNodeEmission"), add("ShaderNodeOutputMaterial")
    for one, other in ((geometry.outputs["Normal"], turn.inputs[0]), (turn.outputs[0], shift.inputs[0])):
        tree.links.new(one, other)
    tree.links.new(shift.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    render(folder / "normals.exr", PHOTO, samples=1)
    high.data.materials[0] = own
    image = bpy.data.images.load(str(folder / "normals.exr"))
    image.colorspace_settings.name = "Non-Color"
    return image


def render(path: Path, size: int, samples: int) -> np.ndarray:
    """(H, W, 4) linear pixels of what the scene's camera sees."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples = "CYCLES", samples
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS" if samples > 1 else "BOX"
    scene.cycles.filter_width = 1.5 if samples > 1 else 0.01
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    pixels = np.empty(4 * size * size, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(size, size, 4)[::-1]


def light_anew() -> None:
    """One white sun from the upper left instead of the rig's lights, and a little from all around."""
    for obj in bpy.context.scene.objects:
        if obj.type == "LIGHT":
            obj.hide_render = True
    camera = bpy.context.scene.camera
    data = bpy.data.lights.new("Unused", "SUN")
    data.energy, data.angle = 3, 0.02
    sun = bpy.data.objects.new("Unused", data)
    sun.matrix_world = camera.matrix_world.to_3x3().to_4x4() @ Euler((-0.7, -0.75, 0)).to_matrix().to_4x4()
    bpy.context.collection.objects.link(sun)


def around(camera: bpy.types.Object, degrees: float) -> Matrix:
    """Where the camera stands after a turn about the world's upright axis; the objects' middle is the origin."""
    return Matrix.Rotation(math.radians(degrees), 4, "Z") @ camera.matrix_world


def looks(obj: bpy.types.Object, others: list[bpy.types.Object], folder: Path, name: str) -> list[np.ndarray]:
    """What is seen from both sides."""
    obj.hide_render = False
    for other in others:
        other.hide_render = True
    camera = bpy.context.scene.camera
    before, found = camera.matrix_world.copy(), []
    for degrees in (0, AROUND):
        camera.matrix_world = around(camera, degrees)
        found.append(render(folder / f"{name}_{degrees}.exr", RESOLUTION, samples=8))
        camera.matrix_world = before
    return found


def difference(found: list[np.ndarray], truth: list[np.ndarray]) -> list[tuple[float, float]]:
    """For each side, the mean and what one pixel in a hundred exceeds, in hundredths."""
    figures = []
    for one, other in zip(found, truth, strict=True):
        inside = np.maximum(one[..., 3], other[..., 3]) > 0.5
        apart = 100 * np.abs(one - other)[inside][:, :3].mean(axis=1)
        figures.append((float(apart.mean()), float(np.quantile(apart, 0.99))))
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description="Render displaced low polys beside their high polys.")
    parser.add_argument("--faces", type=int, default=6000)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--normals", choices=("true", "estimated"), default="true")
    parser.add_argument("--statue", action="append", choices=STATUES)
    arguments = parser.parse_args()
    scans = Path(os.environ.get("MPSNET_TEST_DATA", "")) / "meshes" / "scans"
    blender_addon.register()
    print(" " * 26 + f"{'same side':^15}  {f'{AROUND}° around':^15}")
    worse = False
    for statue in arguments.statue or STATUES:
        with tempfile.TemporaryDirectory() as name, quiet():
            folder = Path(name)
            high, low = pair(scans / f"{statue}.ply", arguments.faces)
            bake(high, low, folder, arguments.size, arguments.normals)
            light_anew()
            truth = looks(high, [low], folder, "high")
            worn = {"normal map alone": looks(low, [high], folder, "normals")}
            for method in METHODS:
                bpy.ops.mps.displace(target=low.name, method=method, output=str(folder / "height.exr"))
                worn[f"displaced, {method.lower()}"] = looks(low, [high], folder, method.lower())
        print(statue.partition("_")[2])
        figures = {what: difference(found, truth) for what, found in worn.items()}
        alone = figures["normal map alone"]
        for what, found in figures.items():
            worse |= bool(np.greater(found, alone).any())
            cells = "  ".join(f"{mean:6.2f} {most:8.1f}" for mean, most in found)
            print(f"{what:>24}  {cells}", flush=True)
    return int(worse)


if __name__ == "__main__":
    sys.exit(main())
