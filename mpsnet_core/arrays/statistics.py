"""Robust scale and weights for least squares with outliers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F64, Floats

# The weight is zero beyond this many standard deviations: 95% efficiency on normal errors.
TUKEY = 4.685
# A normal distribution's standard deviation in median absolute deviations.
DEVIATIONS = 1.4826


def deviation(errors: Floats, minimum: float = 1e-12) -> float:
    """Standard deviation of errors, estimated from their median absolute value; at least `minimum`."""
    return max(DEVIATIONS * float(np.median(np.abs(errors))), minimum)


def biweight(errors: F64, scale: float) -> F64:
    """Weights from 0 to 1 by Tukey's biweight (Beaton and Tukey 1974), for errors of standard deviation `scale`."""
    return np.maximum(1 - np.square(errors / (TUKEY * scale)), 0.0) ** 2.0


# ----------------------------------------------------------------------------------------------------------------------
# Spearman's rank correlation.


MIN_COUNT = 10


def rank_correlation(one: NDArray[np.number[Any]], other: NDArray[np.number[Any]]) -> float | None:
    """Spearman's rank correlation of two series (N,); None if one is constant or there are fewer than ten values."""
    if len(one) < MIN_COUNT or np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    return float(np.corrcoef(_ranks(one), _ranks(other))[0, 1])


def _ranks(values: NDArray[np.number[Any]]) -> F64:
    """Ranks from 1; ties share the mean of theirs."""
    _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[inverse.reshape(-1)]
