"""Samples: photographs of held-out samples, as varied as those that training sees. Models are chosen by this test."""

import os
from collections.abc import Sequence
from functools import partial
from typing import Any

from mpsnet_core.errors import InputError
from mpsnet_core.evaluation.evaluation import Evaluation
from mpsnet_core.evaluation.magnify import check_magnify
from mpsnet_core.evaluation.measure import Case
from mpsnet_core.evaluation.tables import table_of_means
from mpsnet_core.synthesis.photographs.dataset import SampleDataset
from mpsnet_core.synthesis.sample import read_sample_data

# What the photographs of the samples are drawn from.
SEED = 0


class Samples(Evaluation):
    """Samples in folders, each photographed once by the default capture model; the same photographs every time.

    count: how many, spread evenly over the samples in the order of their names; 0 for all. magnify: how many times the
    photographs are magnified, see :func:`mpsnet_core.evaluation.magnify.estimate_magnified`.

    Raises InputError where there are no samples, or the count is below 0; a case does where its sample is damaged.
    """

    title = "Held-out samples, photographed"

    def __init__(
        self, folders: Sequence[str | os.PathLike[str]], *, count: int = 0, magnify: Sequence[int] = (1,)
    ) -> None:
        check_magnify(magnify)
        if count < 0:
            raise InputError(f"{count} samples cannot be measured; choose 0, which is all, or more")
        self._dataset = SampleDataset(folders, seed=SEED, augment=False)
        there = len(self._dataset)
        count = min(count or there, there)
        self.cases = [
            partial(_case, self._dataset, index * there // count, times) for index in range(count) for times in magnify
        ]

    def table(self, rows: Sequence[dict[str, Any]]) -> str:
        """A line for each model, a column for each kind of shape; the last is the mean over all samples."""
        return table_of_means(rows, ("model",), "shape")

    def notes(self, rows: Sequence[dict[str, Any]]) -> list[str]:
        """How the photographs come about."""
        return ["photographed by the default capture model, with crosstalk, noise, JPEG and errors of mask and lights"]

    def skipped(self) -> list[str]:
        """The files that are no whole samples."""
        return [f"left out: {sentence}" for _, sentence in self._dataset.broken]


def _case(dataset: SampleDataset, index: int, magnify: int) -> Case:
    path = dataset.paths[index]
    capture, truth = dataset.capture(index)
    for broken, sentence in dataset.broken:
        if broken == path:  # the next was taken in its place, which is right for training alone
            raise InputError(f"{sentence}; remove {path.name} to measure without it")
    labels = {"object": path.stem, "shape": read_sample_data(path)["recipe"]["shape"]["kind"]}
    return Case(labels, capture, truth, magnify=magnify)
