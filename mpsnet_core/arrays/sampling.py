"""Samples of a large picture: every so many rows and columns."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def grid_step(count: int, wanted: int) -> int:
    """Each how many rows and columns to take a pixel of, so that about `wanted` of `count` are left; 1 for all."""
    return max(1, round(math.sqrt(count / wanted)))


def sampled_rows(mask: NDArray[np.bool_], wanted: int) -> Iterator[tuple[slice, NDArray[np.bool_]]]:
    """About `wanted` pixels from all over a mask (H, W): rows of it one by one, and which pixels of each, (1, W)."""
    step = grid_step(np.count_nonzero(mask), wanted)
    for row in range(0, len(mask), step):
        chosen = np.zeros((1, mask.shape[1]), bool)
        chosen[:, ::step] = mask[row, ::step]
        yield slice(row, row + 1), chosen
