"""Sampling of large images on a regular grid of rows and columns."""

import math
from collections.abc import Iterator

import numpy as np

from mpsnet_core.arrays.types import Bools


def grid_step(count: int, wanted: int) -> int:
    """Step in rows and columns that leaves about `wanted` of `count` pixels; 1 for all."""
    return max(1, round(math.sqrt(count / wanted)))


def sampled_rows(mask: Bools, wanted: int) -> Iterator[tuple[slice, Bools]]:
    """Yield about `wanted` pixels spread over a mask (H, W): a row as a slice, and (1, W) which of its pixels."""
    step = grid_step(np.count_nonzero(mask), wanted)
    for row in range(0, len(mask), step):
        chosen = np.zeros((1, mask.shape[1]), bool)
        chosen[:, ::step] = mask[row, ::step]
        yield slice(row, row + 1), chosen
