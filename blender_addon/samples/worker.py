"""A Blender that makes samples as they are asked for: what the farm starts, as many as it has processes."""

import os
from pathlib import Path

import bpy

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.cycles import sample_from_cycles
from mpsnet_core.synthesis.drawing import draw_recipe
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.recipe import Recipe
from mpsnet_core.synthesis.sample import Sample, write_sample
from mpsnet_core.synthesis.shapes import build_shape
from mpsnet_core.synthesis.work import serve

from ..training_data import SCENE_FILE
from .objects import SceneObjects, add_objects, open_objects
from .render import prepare, render_layers
from .scene import add_shape, sample_scene


def work(folder: str | os.PathLike[str]) -> None:
    """Make the samples of the job in `folder` that are asked for on stdin, see :mod:`mpsnet_core.synthesis.work`.

    The file that is open goes where the job shows the scene's own objects: the folder's ``scene.blend`` is opened.
    """
    serve(folder, Renderer().make)


class Renderer:
    """Makes samples, one after the other; keeps the scene's own objects from one to the next."""

    def __init__(self) -> None:
        self.objects: SceneObjects | None = None

    def make(self, job: SampleJob, number: int, path: Path) -> None:
        """Render sample `number` of the job and write it to `path`, whole or not at all.

        Raises InputError where its shape or materials cannot be rendered or the file not written.
        """
        if job.renderer != "cycles":
            raise InputError(f"the job in {path.parent} is not for Blender; go on with it by mpsnet make")
        write_sample(path, self.sample(draw_recipe(job, number), job, path))

    def sample(self, recipe: Recipe, job: SampleJob, path: Path) -> Sample:
        """Render what a recipe shows; what Blender writes meanwhile lies beside `path` and is removed."""
        own = recipe.shape["kind"] == "scene"
        if own and self.objects is None:
            self.objects = open_objects(path.parent / SCENE_FILE, job.objects)
        # Named as files.written_whole names its own, so that what a killed worker leaves is found and removed.
        raw = path.with_name(f".{path.stem}.{os.getpid()}.unfinished.layers.exr")
        try:
            with sample_scene(recipe) as scene:
                if own and self.objects:
                    mesh = add_objects(scene, recipe, self.objects)
                else:
                    mesh = add_shape(scene, recipe, build_shape(recipe.shape, job.meshes))
                prepare(scene, recipe, job.samples)
                render_layers(scene, raw)
            return sample_from_cycles(raw, recipe, *mesh, renderer=f"Cycles {bpy.app.version_string}")
        finally:
            raw.unlink(missing_ok=True)
