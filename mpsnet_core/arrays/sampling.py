"""Samples of a large picture: every so many rows and columns."""

import math


def grid_step(count: int, wanted: int) -> int:
    """Each how many rows and columns to take a pixel of, so that about `wanted` of `count` are left; 1 for all."""
    return max(1, round(math.sqrt(count / wanted)))
