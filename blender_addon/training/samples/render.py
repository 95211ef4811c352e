"""One Cycles render per sample: three light groups, normals, alpha and materials in one multi-layer EXR.

Each light group is denoised by OpenImageDenoise in the compositor: Cycles denoises the combined image alone. The farm
starts several Blenders that render samples on request.
"""

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.errors import FileError, InputError
from mpsnet_core.io.files import temporary_folder, unfinished_path
from mpsnet_core.synthesis.cycles import LIGHT_GROUPS, sample_from_cycles
from mpsnet_core.synthesis.farm.work import THREADS_VARIABLE, serve
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.sample import Sample, write_sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.scene_sampling import draw_scene
from mpsnet_core.synthesis.shapes import Shape, build_shape

from ...child_process.simulation_caches import simulations_write_into
from ...errors import operator_errors
from ...outputs import with_escaped_braces
from ..training_data import SCENE_FILE
from .materials import weight_passes
from .scene import SceneObjects, add_objects, add_shape, open_objects, sample_scene

LAYER = "ViewLayer"  # the view layer's name, which the names of a render's passes begin with
_FRAME = 1  # Blender 4.5 appends its number to the name of the compositor's file


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
    with operator_errors(f"Blender could not render {path}", "see what it printed"):
        # With denoising, the compositor writes the file.
        bpy.ops.render.render(write_still=not render.use_compositing, scene=scene.name)
    if not path.is_file():
        raise FileError(f"Blender did not write {path}: the render was cancelled or its disk is full; try again")


def denoising_helps(recipe: SceneDescription) -> bool:
    """Whether denoising brings the light closer to the converged render.

    Direct light has hardly any noise: denoising would remove its texture and highlights. Indirect light is noisy.
    """
    return recipe.bounces > 0


def add_denoising(scene: Any, passes: list[str], path: Path) -> Path:
    """Have the compositor write the scene's next render with its light groups denoised. Returns that file's path.

    The file is like a render's own multi-layer EXR. Its path is `path`, with a number that Blender 4.5 appends. passes:
    its passes in addition to Combined and Normal.
    """
    scene.frame_set(_FRAME)
    scene.view_layers[0].cycles.denoising_store_passes = True
    render = scene.render
    render.use_compositing, render.use_file_extension = True, True
    render.compositor_device, render.compositor_precision = "CPU", "FULL"
    if bpy.app.version >= (5, 0):
        scene.compositing_node_group = tree = bpy.data.node_groups.new("MPS Denoising", "CompositorNodeTree")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    rendered = tree.nodes.new("CompositorNodeRLayers")
    rendered.scene = scene
    output = tree.nodes.new("CompositorNodeOutputFile")
    if bpy.app.version >= (5, 0):
        output.format.media_type = "MULTI_LAYER_IMAGE"
        output.directory, output.file_name = with_escaped_braces(path.parent), path.stem
    else:
        output.base_path = with_escaped_braces(path.with_suffix(""))
        path = path.with_name(f"{path.stem}{_FRAME:04d}{path.suffix}")
    output.format.file_format = "OPEN_EXR_MULTILAYER"
    output.format.color_mode, output.format.color_depth, output.format.exr_codec = "RGBA", "32", "ZIPS"
    if bpy.app.version < (5, 0):
        output.layer_slots.clear()

    def add(kind: str, name: str, image: Any) -> None:
        """Write an image as a layer. kind: RGBA, VECTOR or FLOAT."""
        name = f"{LAYER}.{name}"
        if bpy.app.version >= (5, 0):
            output.file_output_items.new(kind, name)
        else:
            output.layer_slots.new(name)
        tree.links.new(image, output.inputs[name])

    add("RGBA", "Combined", rendered.outputs["Image"])
    add("VECTOR", "Normal", rendered.outputs["Normal"])
    for one in passes:
        kind = "FLOAT" if rendered.outputs[one].type == "VALUE" else "RGBA"
        add(kind, one, rendered.outputs[one])
    for group in LIGHT_GROUPS:
        denoise = tree.nodes.new("CompositorNodeDenoise")
        # The guide passes have almost no noise, and prefiltering would remove fine texture.
        if bpy.app.version >= (5, 0):
            denoise.inputs["Prefilter"].default_value, denoise.inputs["Quality"].default_value = "None", "High"
        else:
            denoise.prefilter, denoise.quality = "NONE", "HIGH"
        combined = f"Combined_{group}"
        tree.links.new(rendered.outputs[combined], denoise.inputs["Image"])
        tree.links.new(rendered.outputs["Denoising Normal"], denoise.inputs["Normal"])
        tree.links.new(rendered.outputs["Denoising Albedo"], denoise.inputs["Albedo"])
        add("RGBA", combined, denoise.outputs[0])
    return path


def work(folder: str | os.PathLike[str]) -> None:
    """Make the samples of the job in `folder` that are requested on stdin, see :mod:`mpsnet_core.synthesis.farm.work`.

    If the job uses a scene's own objects, the folder's ``scene.blend`` is opened.
    """
    serve(folder, _make)


def _make(job: SampleJob, number: int, path: Path) -> None:
    if job.renderer != "cycles":
        raise InputError(f"the job in {path.parent} is not for Blender; continue it with mpsnet make")
    recipe = draw_scene(job, number)
    of_scene = recipe.shape["kind"] == "scene"
    shown = _objects(path.parent, job.objects) if of_scene else build_shape(recipe.shape, job.meshes)
    write_sample(path, render_sample(recipe, shown, job.samples, path, denoise=job.denoise))


@lru_cache(maxsize=1)
def _objects(folder: Path, names: tuple[str, ...]) -> SceneObjects:
    """The scene's own objects, which are read once."""
    with temporary_folder() as caches, simulations_write_into(caches):
        return open_objects(folder / SCENE_FILE, names)
