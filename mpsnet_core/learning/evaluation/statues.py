"""Test on statues: matt grey meshes under an exact rig, where equation 2 is wrong only in shadow."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_measures
from mpsnet_core.learning.evaluation.fine_relief import fine_relief
from mpsnet_core.learning.evaluation.measure import Case, Result, Row
from mpsnet_core.learning.evaluation.mesh_views import MeshView, mesh_views
from mpsnet_core.learning.evaluation.operations import EvaluateStatues
from mpsnet_core.learning.evaluation.scenes import ideal_photograph
from mpsnet_core.scene.rig import published_rig
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material

MATT_GREY = Material(base_color=(0.6, 0.6, 0.6), roughness=1.0, specular=0.0)
REACHED = 0.99  # least share of a light at a lit pixel
DETAIL = 0.01  # standard deviation of the Gaussian that separates detail from shape, as a share of the image width


class Statues(Evaluation):
    """Ideal photographs of matt grey meshes from all sides, under lights 120° apart.

    Each view is photographed under each tilt. Without bounces, equation 2 is exact where all lights reach.

    Raises InputError if a file is missing or a number out of range.
    """

    title = "Matt grey statues"

    def __init__(self, options: EvaluateStatues) -> None:
        for tilt in options.tilt:
            published_rig(options.slant, tilt)
        self.bounces = options.bounces
        self.cases = [
            partial(_case, view, options.slant, tilt, options.bounces, options.size, times)
            for view in mesh_views(options.mesh, options.views)
            for tilt in options.tilt
            for times in options.magnify
        ]

    def rows(self, results: Sequence[Result]) -> list[Row]:
        """Rows with an additional "fine_relief" (:func:`.fine_relief.fine_relief`), if known."""
        rows = []
        for result, row in zip(results, super().rows(results), strict=True):
            case = result.case
            sigma = max(DETAIL * case.truth.shape[1], 1.0)
            relief = fine_relief(result.estimate.vectors, case.truth, case.scored, case.regions["lit_mae"], sigma)
            rows.append(row if relief is None else replace(row, further={"fine_relief": round(relief, 4)}))
        return rows

    def table(self, rows: Sequence[Row]) -> str:
        """A line per model and measure, a column per mesh: means over views and tilts."""
        measures = {
            "all pixels": "mae_deg",
            "where all lights reach": "lit_mae_deg",
            "elsewhere": "elsewhere_mae_deg",
            "fine relief kept (1: all)": "fine_relief",
        }
        return table_of_measures(rows, ("model",), measures, "object")

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """A description of the scene."""
        tilts = ", ".join(f"{tilt:g}°" for tilt in dict.fromkeys(row.labels["tilt"] for row in rows))
        return [
            f"matt grey with cast shadows, no noise; the rig is exact; bounces of light: {self.bounces}; first light's "
            f"tilt: {tilts}"
        ]


def _case(view: MeshView, slant: float, tilt: float, bounces: int, size: int, magnify: int) -> Case:
    sample = _sample(view, slant, tilt, bounces, size)
    lit = sample.lit.min(axis=0) >= REACHED
    return Case(
        {**view.labels, "tilt": tilt},
        ideal_photograph(sample, "separated"),
        sample.normals,
        {"lit_mae": lit, "elsewhere_mae": ~lit},
        magnify,
    )


@lru_cache(maxsize=1)
def _sample(view: MeshView, slant: float, tilt: float, bounces: int, size: int) -> Sample:
    recipe = view.recipe((MATT_GREY,), size, bounces=bounces)
    return view.sample(replace(recipe, light_directions=published_rig(slant, tilt).directions))
