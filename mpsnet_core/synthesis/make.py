"""Make a sample without Blender, from its number to its file."""

import json
from functools import lru_cache
from pathlib import Path

from mpsnet_core.errors import SettingsError
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.sample import write_sample
from mpsnet_core.synthesis.scene_sampling import draw_scene
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import Shape, build_shape


def make_sample(job: SampleJob, number: int, path: Path) -> None:
    """Draw, build, shade and write sample `number` of `job`, atomically.

    Raises InputError if the job is for another renderer, a mesh or a measured material cannot be read, or the file
    cannot be written.
    """
    if job.renderer != "synthesis":
        raise SettingsError(f"the job in {path.parent} is for Blender; continue it with mpsnet make")
    recipe = draw_scene(job, number)
    shape = _shape(json.dumps(recipe.shape, sort_keys=True), job.meshes)
    reflectances = [load_reflectance(material, job.merl) for material in recipe.materials]
    write_sample(path, synthesise(recipe, shape, reflectances, job.supersampling))


# Consecutive views show the same shape.
@lru_cache(maxsize=1)
def _shape(description: str, meshes: str) -> Shape:
    return build_shape(json.loads(description), meshes)
