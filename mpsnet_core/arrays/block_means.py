"""Downsampling by block means."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def block_means(pixels: NDArray[np.floating[Any]], factor: int) -> NDArray[np.float32]:
    """(⌈H/factor⌉, ⌈W/factor⌉, C) means of blocks of factor x factor pixels; values that are not finite count as 0."""
    height, width, channels = pixels.shape
    starts = np.arange(0, width, factor)
    counts = np.diff([*starts, width])[:, None]
    small = np.empty((-(-height // factor), len(starts), channels), np.float32)
    for row in range(len(small)):
        rows = np.nan_to_num(pixels[row * factor : (row + 1) * factor], posinf=0, neginf=0)
        small[row] = np.add.reduceat(rows.mean(axis=0, dtype=np.float32), starts, axis=0) / counts
    return small
