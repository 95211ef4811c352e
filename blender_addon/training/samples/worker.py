"""A Blender process that makes samples on request. The farm starts several of them."""

import os
from pathlib import Path

from mpsnet_core.errors import InputError
from mpsnet_core.io.files import temporary_folder
from mpsnet_core.synthesis.farm.work import serve
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.sample import write_sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.scene_sampling import draw_scene
from mpsnet_core.synthesis.shapes import Shape, build_shape

from ...child_process.simulation_caches import simulations_write_into
from ..training_data import SCENE_FILE
from .objects import SceneObjects, open_objects
from .render import render_sample


def work(folder: str | os.PathLike[str]) -> None:
    """Make the samples of the job in `folder` that are requested on stdin, see :mod:`mpsnet_core.synthesis.farm.work`.

    If the job uses a scene's own objects, the folder's ``scene.blend`` is opened.
    """
    serve(folder, _Worker().make)


class _Worker:
    """Makes samples, one after the other. The scene's own objects are read once."""

    def __init__(self) -> None:
        self.objects: SceneObjects | None = None

    def make(self, job: SampleJob, number: int, path: Path) -> None:
        if job.renderer != "cycles":
            raise InputError(f"the job in {path.parent} is not for Blender; continue it with mpsnet make")
        recipe = draw_scene(job, number)
        shown = self._shown(recipe, job, path.parent)
        write_sample(path, render_sample(recipe, shown, job.samples, path, denoise=job.denoise))

    def _shown(self, recipe: SceneDescription, job: SampleJob, folder: Path) -> Shape | SceneObjects:
        if recipe.shape["kind"] != "scene":
            return build_shape(recipe.shape, job.meshes)
        if self.objects is None:
            with temporary_folder() as caches, simulations_write_into(caches):
                self.objects = open_objects(folder / SCENE_FILE, job.objects)
        return self.objects
