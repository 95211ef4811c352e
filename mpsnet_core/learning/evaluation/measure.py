"""Measuring: models against photos whose true normals are known."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rank_correlation import rank_correlation
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import GeometryError
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.registry import AVERAGED_MODEL, registered_models
from mpsnet_core.learning.evaluation.confidence import error_by_confidence
from mpsnet_core.learning.evaluation.magnify import estimate_magnified, magnified_name
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

EVERY_MODEL = "all"


@dataclass(frozen=True)
class Case:
    """One photo whose normals are known.

    labels: of its rows. truth: (H, W, 3) true unit normals in camera space, zero where there are none (a mask that is
    too large reaches there). regions: parts of the picture, (H, W) bool, whose mean errors are reported as well, by
    name. magnify: how many times the photo is magnified before the estimate, which is measured on the photo's own
    pixels; see :func:`mpsnet_core.learning.evaluation.magnify.estimate_magnified`.

    Raises GeometryError where no pixel of the mask has a true normal.
    """

    labels: Mapping[str, Any]
    capture: Capture
    truth: NDArray[np.float32]
    regions: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    magnify: int = 1

    def __post_init__(self) -> None:
        if not self.scored.any():
            raise GeometryError(f"{self.title}: no pixel inside the mask has a true normal; choose another mask")

    @property
    def title(self) -> str:
        """The labels in one line."""
        return magnified_name(", ".join(_format(value) for value in self.labels.values()), self.magnify)

    @property
    def scored(self) -> NDArray[np.bool_]:
        """(H, W) pixels of the mask that have a true normal."""
        known: NDArray[np.bool_] = np.abs(self.truth).max(axis=-1) > 0
        return self.capture.mask & known


@dataclass(frozen=True)
class Result:
    """One model's answer to a case. error: (H, W) angular error in degrees, zero where nothing is scored."""

    case: Case
    model: str
    estimate: NormalMap
    error: NDArray[np.float32]

    @property
    def mae_deg(self) -> float:
        """Mean angular error over the scored pixels, in degrees."""
        return float(self.error[self.case.scored].mean(dtype=np.float64))

    def row(self) -> dict[str, Any]:
        """The result as a row of the table that ``--json`` writes.

        Beside the case's labels, the model and "magnify": "mae_deg", "median_deg", "NAME_deg" for each region that has
        pixels, and for models whose confidence varies "confidence_rank_correlation" (Spearman's, of 1 - confidence and
        error) and "confidence_decile_deg", the mean errors of ten equally large groups of pixels, the most trusted
        first.
        """
        scored = self.case.scored
        error, confidence = self.error[scored], self.estimate.confidence[scored]
        row = {
            **self.case.labels,
            "model": self.model,
            "magnify": self.case.magnify,
            "mae_deg": _rounded(error.mean(dtype=np.float64)),
            "median_deg": _rounded(np.median(error)),
        }
        for name, region in self.case.regions.items():
            if (region & scored).any():
                row[f"{name}_deg"] = _rounded(self.error[region & scored].mean(dtype=np.float64))
        correlation = rank_correlation(1 - confidence, error)
        if correlation is not None:
            row["confidence_rank_correlation"] = _rounded(correlation)
            row["confidence_decile_deg"] = [_rounded(mean) for mean in error_by_confidence(confidence, error)]
        return row


def chosen_models(names: Sequence[str]) -> list[str]:
    """The named models, each once; "all" stands for every model that `mpsnet models` lists."""
    # The averaged model's answer on stills is the default's.
    every = [entry.name for entry in registered_models() if entry.name != AVERAGED_MODEL]
    return list(dict.fromkeys(name for given in names for name in (every if given == EVERY_MODEL else [given])))


def measure(
    cases: Sequence[Callable[[], Case]], models: Sequence[str], progress: Progress = silent
) -> Iterator[list[Result]]:
    """For each case, which is made only then, the results of all models.

    Raises InputError where there is no such model, or a case cannot be made.
    """
    estimators = [Estimator(model) for model in models]
    total = len(cases) * (len(estimators) + 1)  # making a case takes a while too
    for number, make in enumerate(cases):
        start = number * (len(estimators) + 1)
        progress(start / total, f"case {number + 1} of {len(cases)}")
        case = make()
        results = []
        for place, estimator in enumerate(estimators, start + 1):
            message = f"{case.title}, {estimator.name}"
            progress(place / total, message)
            share = part(progress, place / total, (place + 1) / total, message)
            estimate = estimate_magnified(estimator, case.capture, case.magnify, share)
            error = np.where(case.scored, angular_error(estimate.vectors, case.truth), 0).astype(np.float32)
            results.append(Result(case, estimator.name, estimate, error))
        yield results
    progress(1.0, "measured")


def _format(value: object) -> str:
    return "-".join(map(str, value)) if isinstance(value, list) else str(value)


def _rounded(value: Any) -> float:
    return round(float(value), 4)
