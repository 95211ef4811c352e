"""Test on photographs of held-out samples, drawn as for training. Models are selected by this test.

It needs PyTorch (extra ``train``) for :mod:`mpsnet_core.learning.training.photo_simulation`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_errors
from mpsnet_core.learning.evaluation.measure import Case, Result, Row, white_choices
from mpsnet_core.learning.evaluation.operations import EvaluateSamples
from mpsnet_core.learning.evaluation.pixel_kinds import regions_by_kind, share, table_by_kind
from mpsnet_core.learning.training.packed import PackedSamples, box_of_object
from mpsnet_core.learning.training.photo_simulation import simulate_photo
from mpsnet_core.synthesis.capture_model import CaptureModel
from mpsnet_core.synthesis.random_sampling import generator
from mpsnet_core.synthesis.sample import read_sample, read_sample_data

SEED = 0  # of the photographs


class Samples(Evaluation):
    """Samples in folders, each photographed once by the default capture model, reproducibly.

    Raises FileError if there are no samples.
    """

    title = "Held-out samples, photographed"

    def __init__(self, options: EvaluateSamples) -> None:
        self._samples, self._by = PackedSamples(options.folder, skip_damaged=True), options.by
        total = len(self._samples)
        count = min(options.count or total, total)
        self.cases = [
            partial(_case, self._samples, index * total // count, beside, options.by)
            for index in range(count)
            for beside in white_choices(options.white)
        ]

    def rows(self, results: Sequence[Result]) -> list[Row]:
        """Rows for one case, with the share of each kind of pixel."""
        scored = results[0].case.scored
        shares = {share(name): round(float(part[scored].mean()), 4) for name, part in results[0].case.regions.items()}
        return [replace(result.row(), further=shares) for result in results]

    def table(self, rows: Sequence[Row]) -> str:
        """A line per model, a column per kind of shape, then per number of colours; means last. Then kinds of pixel."""
        tables = [table_of_errors(rows, ("model",), column) for column in ("shape", "colours")]
        return "\n\n".join([*tables, *(table_by_kind(rows, kind) for kind in self._by)])

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """How the photographs are made."""
        return ["photographed by the default capture model, with crosstalk, noise, JPEG and errors of mask and lights"]

    def skipped(self) -> list[str]:
        """Why samples were left out."""
        return [f"left out: {reason}" for reason in self._samples.left_out.values()]


def _case(samples: PackedSamples, index: int, white: bool, by: Sequence[str]) -> Case:
    packed, path = samples[index], samples.paths[index]
    rng = generator(SEED, index)
    # All other random draws are the same with and without the white photo.
    capture, truth = simulate_photo(packed, replace(CaptureModel(), white=float(white)).draw(rng))
    recipe = read_sample_data(path)["recipe"]
    kind = recipe["shape"]["kind"]
    many = len(recipe["materials"]) > 1 or recipe["paint"]["amount"] * recipe["paint"]["hue"] > 0
    labels = {"object": path.stem, "shape": kind, "colours": "many" if many else "one", "photos": 1 + white}
    if not by:
        return Case(labels, capture, truth)
    sample = read_sample(path)
    box = box_of_object(sample)
    return Case(labels, capture, truth, {name: part[box] for name, part in regions_by_kind(sample, by).items()})
