"""Measure models on photos with known normals."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, SupportsFloat

import numpy as np

from mpsnet_core.arrays.statistics import rank_correlation
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import GeometryError
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.registry import registered_models
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

# --- calibration of confidence: how well a model predicts its errors --------------------------------------------------


GROUPS = 10
# Pixels sampled from each photo.
PIXELS_A_PHOTO = 4096


def error_by_confidence(confidence: Floats, error: Floats) -> F64:
    """(10,) mean errors of the deciles of confidence, the highest confidence first.

    Pixels of equal confidence have no order: each counts with their mean error.
    """
    _, place, count = np.unique(-confidence, return_inverse=True, return_counts=True)
    shared = np.repeat(np.bincount(place.reshape(-1), error.astype(np.float64)) / count, count)
    return np.array([group.mean() for group in np.array_split(shared, GROUPS)])


@dataclass(frozen=True)
class Calibration:
    """How well a model's confidence predicts its error."""

    model: str
    """The model."""
    rank_correlation: float
    """Spearman's, of 1 - confidence and error."""
    error_deg: list[float]
    """Mean errors of the deciles in degrees, the most confident pixels first."""
    expected_deg: list[float] | None = None
    """Errors in degrees that the model predicts for the same deciles, 90° · (1 - confidence); None for the baselines,
    whose confidence is the share of lights that reach a pixel."""

    def to_json(self) -> dict[str, Any]:
        """The calibration as ``--json`` writes it."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def lines(self) -> list[list[str]]:
        """Lines of a table: model, correlation, measure, ten deciles."""
        lines = [[self.model, f"{self.rank_correlation:.2f}", "error", *(f"{mean:.1f}" for mean in self.error_deg)]]
        if self.expected_deg:
            lines.append(["", "", "expected", *(f"{mean:.1f}" for mean in self.expected_deg)])
        return lines


class ConfidencePool:
    """Confidence and error of pixels from many photos, the same number from each, evenly spaced."""

    def __init__(self) -> None:
        self._pixels: dict[str, list[F32]] = {}
        self._predicting: set[str] = set()

    def add(self, model: str, confidence: F32, error: F32, *, predicts_error: bool = True) -> None:
        """Add the scored pixels (N,) of a photo. predicts_error: False for the baselines, see Calibration."""
        if predicts_error:
            self._predicting.add(model)
        step = -(-len(error) // PIXELS_A_PHOTO)
        self._pixels.setdefault(model, []).append(np.stack([confidence[::step], error[::step]]))

    def calibration(self) -> list[Calibration]:
        """The calibration of each model whose confidence varies, over the pixels of all photos."""
        found = []
        for model, parts in self._pixels.items():
            confidence, error = np.concatenate(parts, axis=1)
            correlation = rank_correlation(1 - confidence, error)
            if correlation is None:
                continue
            expected = None
            if model in self._predicting:
                expected = error_by_confidence(confidence, 90 * (1 - confidence)).round(4).tolist()
            means = error_by_confidence(confidence, error).round(4).tolist()
            found.append(Calibration(model, round(correlation, 4), means, expected))
        return found


EVERY_MODEL = "all"


def white_choices(white: bool) -> tuple[bool, ...]:
    """Variants of each photo to measure: without a white photo and, if `white`, also with one."""
    return (False, True) if white else (False,)


@dataclass(frozen=True)
class Case:
    """One photo with known normals.

    Raises GeometryError if no pixel of the mask has a true normal.
    """

    labels: Mapping[str, Any]
    """Labels of its rows."""
    capture: Capture
    """The photo, H x W pixels, with its mask and lights."""
    truth: F32
    """(H, W, 3) float32. True unit normals in camera space, zero where unknown, which may be inside the mask."""
    regions: Mapping[str, Bools] = field(default_factory=dict)
    """(H, W) bool by name. Parts of the image whose mean errors are also reported."""

    def __post_init__(self) -> None:
        if not self.scored.any():
            raise GeometryError(f"{self.title}: no pixel inside the mask has a true normal; choose another mask")

    @property
    def title(self) -> str:
        """The labels in one line."""
        labels = [_format(value) for name, value in self.labels.items() if name != "photos"]
        if self.labels.get("photos", 1) > 1:
            labels.append("with a white photo")
        return ", ".join(labels)

    @property
    def scored(self) -> Bools:
        """(H, W) pixels inside the mask with a true normal."""
        known: Bools = np.abs(self.truth).max(axis=-1) > 0
        return self.capture.mask & known


@dataclass(frozen=True)
class Row:
    """One model's metrics on a case, angles in degrees."""

    labels: Mapping[str, Any]
    """The case's labels, and "model"."""
    errors: Mapping[str, float]
    """"mae_deg", "median_deg", and "NAME_deg" for each region that has pixels."""
    rank_correlation: float | None = None
    """Spearman's, of 1 - confidence and error; None if the confidence does not vary."""
    decile_deg: list[float] | None = None
    """Mean errors of the deciles of confidence, the highest first; None if the confidence does not vary."""
    further: Mapping[str, float] = field(default_factory=dict)
    """Metrics of some tests only."""

    @property
    def mae_deg(self) -> float:
        return self.errors["mae_deg"]

    def figure(self, key: str) -> float | None:
        """One of the errors or further metrics, None if the row does not have it."""
        return self.errors.get(key, self.further.get(key))

    def line(self, *keys: str) -> tuple[str, ...]:
        """The labels of these keys as text."""
        return tuple(str(self.labels[key]) for key in keys)

    def labelled(self, **labels: str) -> "Row":
        """The same metrics with changed or additional labels."""
        return replace(self, labels={**self.labels, **labels})

    def to_json(self) -> dict[str, Any]:
        """The row as ``--json`` writes it: one flat object."""
        ranked = {"confidence_rank_correlation": self.rank_correlation, "confidence_decile_deg": self.decile_deg}
        known = {} if self.rank_correlation is None else ranked
        return {**self.labels, **self.errors, **known, **self.further}


@dataclass(frozen=True)
class Result:
    """One model's estimate of a case."""

    case: Case
    """The case, H x W pixels."""
    model: str
    """The model."""
    estimate: NormalMap
    """The normals that it estimated."""
    error: F32
    """(H, W) float32. Angular error in degrees, zero at pixels that are not scored."""

    @property
    def mae_deg(self) -> float:
        """Mean angular error over the scored pixels, in degrees."""
        return float(self.error[self.case.scored].mean(dtype=np.float64))

    def row(self) -> Row:
        """The metrics of the result, rounded."""
        scored = self.case.scored
        error, confidence = self.error[scored], self.estimate.confidence[scored]
        errors = {"mae_deg": _rounded(error.mean(dtype=np.float64)), "median_deg": _rounded(np.median(error))}
        for name, region in self.case.regions.items():
            if (region & scored).any():
                errors[f"{name}_deg"] = _rounded(self.error[region & scored].mean(dtype=np.float64))
        row = Row({**self.case.labels, "model": self.model}, errors)
        correlation = rank_correlation(1 - confidence, error)
        if correlation is None:
            return row
        deciles = [_rounded(mean) for mean in error_by_confidence(confidence, error)]
        return replace(row, rank_correlation=_rounded(correlation), decile_deg=deciles)


def chosen_models(names: Sequence[str]) -> list[str]:
    """The named models without duplicates; "all" means what `mpsnet models` lists."""
    every = [entry.name for entry in registered_models()]
    return list(dict.fromkeys(name for given in names for name in (every if given == EVERY_MODEL else [given])))


def measure(
    cases: Sequence[Callable[[], Case]], models: Sequence[str], progress: Progress = silent
) -> Iterator[list[Result]]:
    """Results of all models, case by case. A case is made when its turn comes.

    Raises InputError if there is no such model, or a case cannot be made.
    """
    estimators = [Estimator(model) for model in models]
    total = len(cases) * (len(estimators) + 1)  # making a case takes time, too
    for number, make in enumerate(cases):
        start = number * (len(estimators) + 1)
        progress(start / total, f"case {number + 1} of {len(cases)}")
        case = make()
        results = []
        for place, estimator in enumerate(estimators, start + 1):
            message = f"{case.title}, {estimator.name}"
            progress(place / total, message)
            share = part(progress, place / total, (place + 1) / total, message)
            estimate = estimator(case.capture, share)
            error = np.where(case.scored, angular_error(estimate.vectors, case.truth), 0).astype(np.float32)
            results.append(Result(case, estimator.name, estimate, error))
        yield results
    progress(1.0, "measured")


def _format(value: object) -> str:
    return "-".join(map(str, value)) if isinstance(value, list) else str(value)


def _rounded(value: SupportsFloat) -> float:
    return round(float(value), 4)
