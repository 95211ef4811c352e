"""Test of materials: blobs of each measured material, as in figure 5 of the paper."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from mpsnet_core.estimate.registry import LAMBERTIAN
from mpsnet_core.io.text_table import mean_cell, table_of_means, text_table
from mpsnet_core.learning.evaluation.evaluation import Evaluation
from mpsnet_core.learning.evaluation.measure import Case, Row
from mpsnet_core.learning.evaluation.operations import EvaluateMaterials
from mpsnet_core.learning.evaluation.report import Curve, line_chart
from mpsnet_core.learning.evaluation.scenes import built_blob, held_out_blob, ideal_photograph, published_view
from mpsnet_core.synthesis.reflectance import load_reflectance, material_names
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material
from mpsnet_core.synthesis.scene_sampling import HELD_OUT
from mpsnet_core.synthesis.shading.synthesise import synthesise

# Classes of materials by words in their names; the first that fits counts.
CLASSES = {
    "metallic paint": ("metallic-paint", "gold-paint", "silver-paint", "pearl-paint", "color-changing"),
    "paint": ("paint",),
    "fabric": ("fabric", "felt", "satin"),
    "wood": ("cherry-", "maple-", "fruitwood-", "pine-", "natural-", "oak-", "walnut-"),
    "metal": ("bronze", "aluminium", "brass", "chrome", "steel", "ss4", "nickel", "hematite", "two-layer", "tungsten"),
    "plastic": ("plastic", "phenolic", "acrylic", "nylon", "delrin", "polyethylene", "pvc", "teflon", "bball"),
    "rubber": ("rubber", "latex", "foam"),
    "other": ("",),
}


class Materials(Evaluation):
    """Held-out blobs of each material in a MERL folder or a file of fits to MERL.

    Raises InputError if there are no such materials.
    """

    title = "A blob, each measured material"
    always = (LAMBERTIAN,)  # materials are sorted by its error

    def __init__(self, options: EvaluateMaterials) -> None:
        materials = material_names(options.merl)
        self._are_fits = materials[0][0] == "fit"
        self._held_out = {_title(name) for _, name in materials[::HELD_OUT]}
        self.cases = [
            partial(_case, options.merl, kind, name, protocol, options.size, blob)
            for blob in range(options.blobs)
            for kind, name in materials
            for protocol in options.protocol
        ]

    def table(self, rows: Sequence[Row]) -> str:
        """Mean, held-out mean, median and largest error with its material, and the mean by class, per model."""
        lines = []
        for protocol, models in _by_material(rows).items():
            for model, errors in models.items():
                worst = max(errors, key=errors.__getitem__)
                held_out = mean_cell([error for material, error in errors.items() if material in self._held_out])
                others = [f"{value:.2f}" for value in (np.median([*errors.values()]), errors[worst])]
                lines.append([protocol, model, mean_cell([*errors.values()]), held_out, *others, worst])
        by_class = table_of_means(
            ["protocol", "model"],
            ((row.line("protocol", "model"), material_class(*row.line("material")), row.mae_deg) for row in rows),
        )
        summary = text_table(["protocol", "model", "mean", "held-out", "median", "largest", "with"], lines, 2)
        return f"{summary}\n\nmean error by class of material\n{by_class}"

    def charts(self, rows: Sequence[Row]) -> list[str]:
        """Charts like figure 5, one per protocol: the error per material, sorted by the baseline's."""
        charts = []
        for protocol, models in _by_material(rows).items():
            order = sorted(models[LAMBERTIAN], key=models[LAMBERTIAN].__getitem__)
            curves = []
            for model, errors in models.items():
                words = [f"{material}: {errors[material]:.2f}°" for material in order]
                curves.append(Curve(model, range(1, len(order) + 1), [errors[material] for material in order], words))
            title = f"{len(order)} materials, {protocol}"
            charts.append(line_chart(title, curves, "materials by the baseline's error", "mean error in degrees"))
        return charts

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """The photographed materials and shape."""
        fits = ["the materials are neural fits to MERL (Sztrajman et al. 2021), not MERL"] if self._are_fits else []
        return [
            *fits,
            "the blobs' seeds lie outside those that training data are drawn from; held-out: mean of every fifth "
            "material, which mpsnet synthesize --merl-part training leaves out",
        ]


def _by_material(rows: Sequence[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """Mean error over all blobs, for each protocol, model and material."""
    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    for row in rows:
        protocol, model, material = row.line("protocol", "model", "material")
        found.setdefault(protocol, {}).setdefault(model, {}).setdefault(material, []).append(row.mae_deg)
    return {
        protocol: {
            model: {material: float(np.mean(values)) for material, values in errors.items()}
            for model, errors in models.items()
        }
        for protocol, models in found.items()
    }


def material_class(name: str) -> str:
    """The class of :data:`CLASSES` that a material's name tells."""
    return next(title for title, words in CLASSES.items() if any(word in name for word in words))


def _title(name: str) -> str:
    return name.removesuffix(".binary")


def _case(merl: str, kind: Literal["merl", "fit"], name: str, protocol: str, size: int, blob: int) -> Case:
    sample = _sample(merl, kind, name, size, blob)
    labels = {"object": f"blob {blob + 1}", "material": _title(name), "protocol": protocol}
    return Case(labels, ideal_photograph(sample, protocol), sample.normals)


@lru_cache(maxsize=1)
def _sample(merl: str, kind: Literal["merl", "fit"], name: str, size: int, blob: int) -> Sample:
    material = Material(kind=kind, source=name)
    recipe = published_view(held_out_blob(blob), (material,), size, bounces=1)
    return synthesise(recipe, built_blob(blob), [load_reflectance(material, merl)])
