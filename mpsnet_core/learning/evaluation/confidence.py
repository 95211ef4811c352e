"""Calibration of confidence: how well a model predicts its errors."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.statistics import rank_correlation

GROUPS = 10
# Pixels sampled from each photo.
PIXELS_A_PHOTO = 4096


def error_by_confidence(confidence: NDArray[np.floating[Any]], error: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
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
        self._pixels: dict[str, list[NDArray[np.float32]]] = {}
        self._predicting: set[str] = set()

    def add(
        self, model: str, confidence: NDArray[np.float32], error: NDArray[np.float32], *, predicts_error: bool = True
    ) -> None:
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
