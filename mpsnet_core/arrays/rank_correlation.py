"""Spearman's rank correlation."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F64

MIN_COUNT = 10


def rank_correlation(one: NDArray[np.number[Any]], other: NDArray[np.number[Any]]) -> float | None:
    """Spearman's rank correlation of two series (N,); None if one is constant or there are fewer than ten values."""
    if len(one) < MIN_COUNT or np.ptp(one) == 0 or np.ptp(other) == 0:
        return None
    return float(np.corrcoef(_ranks(one), _ranks(other))[0, 1])


def _ranks(values: NDArray[np.number[Any]]) -> F64:
    """Ranks from 1; ties share the mean of theirs."""
    _, inverse, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks: F64 = (np.cumsum(count) - (count - 1) / 2)[inverse.reshape(-1)]
    return ranks
