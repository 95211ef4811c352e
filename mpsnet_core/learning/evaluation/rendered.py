"""Test on rendered mesh files with one and with several materials, as in figure 6 of the paper."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_errors
from mpsnet_core.learning.evaluation.measure import Case, Row
from mpsnet_core.learning.evaluation.operations import EvaluateRendered
from mpsnet_core.learning.evaluation.published import FIGURE_6
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_SEED, MeshView, ideal_photograph, mesh_views
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.random_sampling import generator
from mpsnet_core.synthesis.reflectance import material_names
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material, Pattern
from mpsnet_core.synthesis.scene_sampling import HELD_OUT, draw_scene

SEVERAL = 4  # materials


class Rendered(Evaluation):
    """Synthesised views of meshes from all sides, with one material and with several in a pattern.

    Views and materials are the same every time. Only held-out measured materials, every fifth one, are used.

    Raises InputError if a file is missing or there are no meshes or materials.
    """

    title = "Rendered meshes"

    def __init__(self, options: EvaluateRendered) -> None:
        self.measured = bool(options.merl)
        self.cases = [
            partial(_case, view, count, number, options.merl, protocol, options.size)
            for number, view in enumerate(mesh_views(options.mesh, options.views))
            for count in (1, SEVERAL)
            for protocol in options.protocol
        ]

    def table(self, rows: Sequence[Row]) -> str:
        """A line per protocol and model, a column per mesh with one and with several materials."""
        named = [row.labelled(picture=", ".join(row.line("object", "materials"))) for row in rows]
        return table_of_errors(named, ("protocol", "model"), "picture")

    def published(self, rows: Sequence[Row]) -> list[dict[str, Any]]:
        """The paper's figure 6, which is for other meshes."""
        return [{"model": "MPS-Net", "mae_deg": error, "source": "Figure 6"} for error in FIGURE_6]

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """The materials, and the paper's results on its meshes."""
        figure = ", ".join(f"{error:.2f}" for error in FIGURE_6)
        kind = "every fifth of the measured ones, or of fits to them" if self.measured else "principled materials"
        return [
            f"of one and of {SEVERAL} materials: {kind}; one bounce of light, three point lights, orthographic",
            f"paper, on other meshes than these: MPS-Net {figure} (figure 6 of Ju et al. 2019)",
        ]


def _case(view: MeshView, count: int, number: int, merl: str, protocol: str, size: int) -> Case:
    sample = _sample(view, count, number, merl, size)
    labels = {**view.labels, "materials": "one" if count == 1 else "several", "protocol": protocol}
    return Case(labels, ideal_photograph(sample, protocol), sample.normals)


@lru_cache(maxsize=1)
def _sample(view: MeshView, count: int, number: int, merl: str, size: int) -> Sample:
    pattern = Pattern("voronoi" if number % 2 else "noise", scale=2.5, seed=number)
    return view.sample(view.recipe(_materials(number, count, merl), size, pattern=pattern, bounces=1), merl)


def _materials(number: int, count: int, merl: str) -> tuple[Material, ...]:
    """Materials of image `number`. Measured materials are all different within an image."""
    if merl:
        names = material_names(merl)[::HELD_OUT]
        rng = generator(HELD_OUT_SEED, number)
        chosen = rng.permutation(len(names))[np.arange(count) % len(names)]
        return tuple(Material(kind=names[place][0], source=names[place][1]) for place in chosen)
    job = SampleJob("synthesis", 1, seed=HELD_OUT_SEED)
    return tuple(draw_scene(job, SEVERAL * number + place).materials[0] for place in range(count))
