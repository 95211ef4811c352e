"""Robust scale and weights for least squares with outliers."""

import numpy as np
from numpy.typing import NDArray

# Beyond so many standard deviations the weight is zero: 95% efficiency on normal errors.
TUKEY = 4.685
# A normal distribution's standard deviation in median absolute deviations.
DEVIATIONS = 1.4826


def spread(errors: NDArray[np.float64], trusted: NDArray[np.bool_]) -> float:
    """Standard deviation of the trusted errors, estimated from their median absolute value."""
    return max(DEVIATIONS * float(np.median(np.abs(errors[trusted]))), 1e-12)


def biweight(errors: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Weights in 0 to 1 by Tukey's biweight (Beaton and Tukey 1974), for errors of standard deviation `scale`."""
    weights: NDArray[np.float64] = np.maximum(1 - np.square(errors / (TUKEY * scale)), 0.0) ** 2.0
    return weights
