"""Materials: one blob under each measured material, figure 5 of the paper."""

import os
from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from mpsnet_core.defaults import SYNTHETIC_SIZE
from mpsnet_core.estimate.registry import LAMBERTIAN
from mpsnet_core.io.text_table import mean_cell, text_table
from mpsnet_core.learning.evaluation.charts import Curve, line_chart
from mpsnet_core.learning.evaluation.evaluation import Evaluation
from mpsnet_core.learning.evaluation.measure import Case, Row
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_BLOB, held_out_blob, ideal_photograph, published_view
from mpsnet_core.synthesis.drawing import HELD_OUT
from mpsnet_core.synthesis.recipe import Material
from mpsnet_core.synthesis.reflectance import load_reflectance, material_names
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.shading.synthesise import synthesise


class Materials(Evaluation):
    """A blob that no training data shows, under each material of a folder of MERL or a file of fits to it.

    merl: folder of ``.binary`` files or the ``.npz``. protocols: of the photo's colours, see
    :func:`mpsnet_core.learning.evaluation.scenes.ideal_photograph`. size: pixels a side.

    Raises InputError where there are no such materials.
    """

    title = "One blob, each measured material"
    always = (LAMBERTIAN,)  # whose error the materials are sorted by

    def __init__(
        self, merl: str | os.PathLike[str], *, protocols: Sequence[str] = ("published",), size: int = SYNTHETIC_SIZE
    ) -> None:
        source = os.fspath(merl)
        materials = material_names(source)
        self._are_fits = materials[0][0] == "fit"
        self._held_out = {_title(name) for _, name in materials[::HELD_OUT]}
        self.cases = [
            partial(_case, source, kind, name, protocol, size) for kind, name in materials for protocol in protocols
        ]

    def table(self, rows: Sequence[Row]) -> str:
        """Each model's mean, held-out mean, median and largest error, and the material of the largest."""
        lines = []
        for (protocol, model), own in _grouped(rows).items():
            errors = [row.mae_deg for row in own]
            worst = max(own, key=lambda row: row.mae_deg)
            held_out = mean_cell([row.mae_deg for row in own if row.labels["material"] in self._held_out])
            others = [f"{value:.2f}" for value in (np.median(errors), worst.mae_deg)]
            lines.append([protocol, model, mean_cell(errors), held_out, *others, worst.labels["material"]])
        return text_table(["protocol", "model", "mean", "held-out", "median", "largest", "with"], lines, 2)

    def charts(self, rows: Sequence[Row]) -> list[str]:
        """Figure 5's curve, a chart a protocol: each material's error, in the order of the baseline's."""
        grouped = _grouped(rows)
        charts = []
        for protocol in dict.fromkeys(protocol for protocol, _ in grouped):
            order = sorted(grouped[protocol, LAMBERTIAN], key=lambda row: row.mae_deg)
            places = {row.labels["material"]: place for place, row in enumerate(order, 1)}
            curves = []
            for model in (model for group, model in grouped if group == protocol):
                own = sorted(grouped[protocol, model], key=lambda row: places[row.labels["material"]])
                words = [f"{row.labels['material']}: {row.mae_deg:.2f}°" for row in own]
                curves.append(Curve(model, range(1, len(own) + 1), [row.mae_deg for row in own], words))
            title = f"{len(order)} materials, {protocol}"
            charts.append(
                line_chart(title, curves, "materials by the baseline's error", "mean angular error in degrees")
            )
        return charts

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """The photographed materials and shape."""
        fits = ["the materials are neural fits to MERL (Sztrajman et al. 2021), not MERL"] if self._are_fits else []
        return [
            *fits,
            "the blob's seed lies outside those that training data are drawn from; held-out: mean of every fifth "
            "material, which mpsnet synthesize --merl-part training leaves out",
        ]


def _grouped(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.labels["protocol"], row.labels["model"]), []).append(row)
    return groups


def _title(name: str) -> str:
    return name.removesuffix(".binary")


def _case(merl: str, kind: Literal["merl", "fit"], name: str, protocol: str, size: int) -> Case:
    sample = _sample(merl, kind, name, size)
    labels = {"object": "blob", "material": _title(name), "protocol": protocol}
    return Case(labels, ideal_photograph(sample, protocol), sample.normals)


@lru_cache(maxsize=1)
def _sample(merl: str, kind: Literal["merl", "fit"], name: str, size: int) -> Sample:
    material = Material(kind=kind, source=name)
    recipe = published_view(HELD_OUT_BLOB, (material,), size, bounces=1)
    return synthesise(recipe, held_out_blob(), [load_reflectance(material, merl)])
