"""Gaussian smoothing."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]


def gaussian(values: Floats, sigma: float, axes: Iterable[int]) -> Floats:
    """Values smoothed by a Gaussian of standard deviation `sigma` along these axes; zero beyond their ends.

    >>> gaussian(np.array([0.0, 0.0, 1.0, 0.0, 0.0]), 0.5, [0]).round(2).tolist()
    [0.0, 0.11, 0.79, 0.11, 0.0]
    """
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel = (kernel / kernel.sum()).astype(values.dtype)
    for axis in axes:
        padded = np.pad(values, [(reach, reach) if a == axis else (0, 0) for a in range(values.ndim)])
        values = np.zeros_like(values)
        along, shifted = values.swapaxes(0, axis), padded.swapaxes(0, axis)
        for k, weight in enumerate(kernel):
            along += weight * shifted[k : k + len(along)]
    return values
