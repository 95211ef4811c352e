"""One Cycles render per sample: three light groups, normals, alpha and materials in one multi-layer EXR."""

import os
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.errors import FileError
from mpsnet_core.io.files import unfinished_path
from mpsnet_core.synthesis.cycles import sample_from_cycles
from mpsnet_core.synthesis.farm.work import THREADS_VARIABLE
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shapes import Shape

from ...errors import operator_report
from ...outputs import with_escaped_braces
from .denoising import add_denoising, denoising_helps
from .materials import weight_passes
from .objects import SceneObjects, add_objects
from .scene import add_shape, sample_scene


def render_sample(
    recipe: SceneDescription, shown: Shape | SceneObjects, samples: int, path: Path, *, denoise: bool = False
) -> Sample:
    """Render a shape with the recipe's materials, or a scene's objects with their own, from the recipe's camera.

    samples: Cycles samples per pixel for all lights together, rounded up to a multiple of four. path: temporary files
    are written next to it. denoise: whether to denoise recipes that gain from it.

    Raises InputError if a material is measured, or the render or its file fails.
    """
    layers = unfinished_path(path, ".layers.exr")  # a name that lets leftovers of a killed worker be removed
    with sample_scene(recipe) as scene:
        add = add_objects if isinstance(shown, SceneObjects) else add_shape
        vertices, triangles = add(scene, recipe, shown)  # type: ignore[arg-type]
        prepare(scene, recipe, samples)
        if denoise and denoising_helps(recipe):
            passes = weight_passes(recipe) or ["Material Index" if bpy.app.version >= (5, 0) else "IndexMA"]
            layers = add_denoising(scene, passes, layers)
        try:
            render_layers(scene, layers)
            return sample_from_cycles(layers, recipe, vertices, triangles, f"Cycles {bpy.app.version_string}")
        finally:
            layers.unlink(missing_ok=True)


def prepare(scene: Any, recipe: SceneDescription, samples: int) -> None:
    """Set up a scene for a render of the recipe with this many samples per pixel."""
    render, cycles, layer = scene.render, scene.cycles, scene.view_layers[0]
    render.engine = "CYCLES"
    render.film_transparent = True
    render.use_compositing = render.use_sequencer = render.use_simplify = render.use_file_extension = False
    if threads := int(os.environ.get(THREADS_VARIABLE, 0)):
        render.threads_mode, render.threads = "FIXED", threads
    cycles.device = "CPU"
    # Distributes the samples evenly among the four suns, see scene.py.
    cycles.samples = -(-samples // 4) * 4
    cycles.sampling_pattern, cycles.use_light_tree = "TABULATED_SOBOL", False
    cycles.seed = int(np.random.SeedSequence([recipe.seed, recipe.number]).generate_state(1)[0] >> 1)
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.light_sampling_threshold = 0.0
    cycles.pixel_filter_type = "BOX"
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = recipe.bounces
    cycles.transmission_bounces = cycles.volume_bounces = 0
    layer.use_pass_normal = True
    layer.use_pass_z = False
    layer.use_pass_material_index = not recipe.materials
    for name in weight_passes(recipe):
        layer.aovs.add().name = name


def render_layers(scene: Any, path: Path) -> None:
    """Render a scene into a float multi-layer EXR. Raises InputError if Blender cannot."""
    render = scene.render
    settings = render.image_settings
    if bpy.app.version >= (5, 0):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIPS"
    render.filepath = with_escaped_braces(path)
    try:
        # With denoising, the compositor writes the file.
        bpy.ops.render.render(write_still=not render.use_compositing, scene=scene.name)
    except RuntimeError as error:
        raise FileError(f"Blender could not render {path}: {operator_report(error)}") from None
    if not path.is_file():
        raise FileError(f"Blender did not write {path}: the render was cancelled or its disk is full; try again")
