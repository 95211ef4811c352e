"""Robust scale and weights for least squares with outliers."""

import numpy as np

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
    weights: F64 = np.maximum(1 - np.square(errors / (TUKEY * scale)), 0.0) ** 2.0
    return weights
