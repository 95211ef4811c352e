"""What tests make with Blender: meshes, plain materials, pictures by Cycles, image files."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import OpenImageIO as oiio


def matte() -> "bpy.types.Material":
    """White, without gloss: the core's Lambertian model in Blender."""
    return principled("Matte", (0.8, 0.8, 0.8), **{"Specular IOR Level": 0.0})


def principled(name: str, color: tuple[float, float, float], **inputs: Any) -> "bpy.types.Material":
    """A material of one Principled BSDF; other inputs than the color by their names."""
    material = bpy.data.materials.new(name)
    shader = shader_of(nodes_of(material))
    for key, value in {"Base Color": (*color, 1), **inputs}.items():
        shader.inputs[key].default_value = value
    return material


def shader_of(tree: "bpy.types.NodeTree") -> "bpy.types.Node":
    """The Principled BSDF that a new material has."""
    return next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")


def nodes_of(material: "bpy.types.Material") -> "bpy.types.NodeTree":
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    return material.node_tree


def write_exr_files(render: "bpy.types.RenderSettings") -> None:
    """Let renders be EXR files of floats."""
    if bpy.app.version >= (5, 0):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"


def array_of(collection: object, name: str, width: int, kind: type = np.float32) -> np.ndarray:
    """(N, width) a property of all things in a collection of Blender's."""
    values = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, values)
    return values.reshape(-1, width)


def rendered(path: Path, width: int, height: int, samples: int) -> np.ndarray:
    """(H, W, C) what the scene's camera sees, by Cycles, which also writes it to the EXR file `path`."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.render.resolution_x, scene.render.resolution_y = width, height
    write_exr_files(scene.render)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return pixels(path)


def save_png(path: Path, colours: np.ndarray) -> Path:
    """Write colours (H, W, 3), row 0 on top, with 16 bits."""
    height, width, _ = colours.shape
    image = bpy.data.images.new(path.stem, width, height, float_buffer=True, is_data=True)
    image.pixels.foreach_set(np.dstack([colours[::-1], np.ones((height, width))]).astype(np.float32).ravel())
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return path


def pixels(path: Path) -> np.ndarray:
    """(H, W, C) of the first part of an EXR."""
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


# Size of the photo of the statue.
STATUE = (320, 256)


def statue() -> "bpy.types.Object":
    """A smooth monkey with a box on its head: no two views of it look alike."""
    bpy.ops.mesh.primitive_monkey_add()
    obj = bpy.context.object
    bpy.ops.mesh.primitive_cube_add(size=0.7, location=(0.5, 0.1, 0.9))
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.join()
    obj.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    obj.rotation_euler, obj.location = (0.2, -0.15, 0.5), (0.3, -0.2, 0.4)
    bpy.ops.object.shade_smooth()
    obj.data.materials.append(matte())
    return obj


def detailed_object(path: Path | None = None, subdivisions: int = 6) -> "bpy.types.Object":
    """A mesh from a file, or one of our own with bumps of two sizes; about 2 across, smooth, at the origin.

    subdivisions: of the ball that our own is made of; its faces are four times as many with each, 20480 with 6.
    """
    if path is None:
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=subdivisions)
        obj = bpy.context.object
        points = array_of(obj.data.vertices, "co", 3).astype(np.float64)
        x, y, z = points.T
        height = 0.06 * np.sin(4 * x) * np.sin(5 * y + 1) * np.cos(4 * z) + 0.012 * np.sin(23 * x + 3) * np.sin(
            21 * y
        ) * np.sin(25 * z + 1)
        points *= 0.85 * (1 + height)[:, None]
    else:
        bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
        obj = bpy.context.object
        points = array_of(obj.data.vertices, "co", 3).astype(np.float64)
        low, high = points.min(axis=0), points.max(axis=0)
        points = (points - (low + high) / 2) * 2 / np.linalg.norm(high - low)
    obj.data.vertices.foreach_set("co", points.astype(np.float32).ravel())
    obj.data.update()
    obj.data.polygons.foreach_set("use_smooth", [True] * len(obj.data.polygons))
    obj.name = "Detailed"
    return obj


def simplified(detailed: "bpy.types.Object", faces: int) -> "bpy.types.Object":
    """Its copy decimated to about `faces` triangles, with UVs."""
    obj = detailed.copy()
    obj.data, obj.name = detailed.data.copy(), "Simplified"
    bpy.context.scene.collection.objects.link(obj)
    activate(obj)
    modifier = obj.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio = faces / len(obj.data.polygons)
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.003)
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def activate(obj: "bpy.types.Object", *others: "bpy.types.Object") -> None:
    bpy.ops.object.select_all(action="DESELECT")
    for one in (obj, *others):
        one.select_set(True)
    bpy.context.view_layer.objects.active = obj


def set_up_cycles(size: int) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    # One sample in the very middle of the pixel.
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    scene.render.film_transparent = True
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    write_exr_files(scene.render)
    scene.render.image_settings.color_mode = "RGBA"


def with_materials(*objects: "bpy.types.Object") -> None:
    for obj in objects:
        obj.data.materials.clear()
        obj.data.materials.append(bpy.data.materials.new(obj.name))
