"""Test on statues: matt grey meshes under an exact rig, where equation 2 is wrong only in shadow."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_measures
from mpsnet_core.learning.evaluation.measure import Case, Result, Row
from mpsnet_core.learning.evaluation.operations import EvaluateStatues
from mpsnet_core.learning.evaluation.scenes import MeshView, ideal_photograph, mesh_views
from mpsnet_core.scene.rig import published_rig
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material

# Least share of a pixel's neighbourhood, weighted by the Gaussian, that must be inside the object.
MIN_INSIDE = 0.999


def fine_relief(estimate: F32, truth: F32, mask: Bools, lit: Bools, sigma: float) -> float | None:
    """Regression coefficient of the estimate's detail on the true detail: 1 if all is kept, 0 if none is.

    estimate, truth: (H, W, 3) unit normals. mask, lit: (H, W) the object's pixels, and those that all lights reach.
    sigma: of the Gaussian in pixels.

    Detail is the difference of the normals' x and y from their Gaussian mean. Both are over lit pixels only, because
    errors in shadow would spread, and pixels near the outline are ignored. The coefficient is the least-squares slope
    through the origin: noise does not bias it, and above 1 detail is exaggerated. None if the truth has no detail.
    """
    lit = lit & mask
    counted = lit & (_blurred(mask[..., None], sigma)[..., 0] > MIN_INSIDE)
    weight = np.maximum(_blurred(lit[..., None], sigma), 1e-6)

    def detail(normals: F32) -> F64:
        across = np.where(lit[..., None], normals[..., :2], 0)
        high: F64 = across - _blurred(across, sigma) / weight
        return high[counted]

    found, true = detail(estimate), detail(truth)
    size = float((true**2).sum())
    return float((found * true).sum()) / size if size > 1e-9 else None


def _blurred(values: NDArray[np.generic], sigma: float) -> F64:
    """Values (H, W, C) convolved with a Gaussian, zero-padded."""
    height, width, _ = values.shape
    size = [side + int(np.ceil(4 * sigma)) for side in (height, width)]
    frequency = np.hypot(np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1]))
    passed = np.exp(-2 * (np.pi * sigma * frequency) ** 2)[..., None]
    spectrum = np.fft.rfft2(values.astype(np.float64), size, axes=(0, 1))
    return np.fft.irfft2(spectrum * passed, size, axes=(0, 1))[:height, :width]


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
            partial(_case, view, options.slant, tilt, options.bounces, options.size)
            for view in mesh_views(options.mesh, options.views)
            for tilt in options.tilt
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


def _case(view: MeshView, slant: float, tilt: float, bounces: int, size: int) -> Case:
    sample = _sample(view, slant, tilt, bounces, size)
    lit, photo = sample.lit.min(axis=0) >= REACHED, ideal_photograph(sample, "separated")
    return Case({**view.labels, "tilt": tilt}, photo, sample.normals, {"lit_mae": lit, "elsewhere_mae": ~lit})


@lru_cache(maxsize=1)
def _sample(view: MeshView, slant: float, tilt: float, bounces: int, size: int) -> Sample:
    recipe = view.recipe((MATT_GREY,), size, bounces=bounces)
    return view.sample(replace(recipe, light_directions=published_rig(slant, tilt).directions))
