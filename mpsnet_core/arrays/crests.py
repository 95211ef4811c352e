"""Crests: where a gradient is steepest across an edge."""

import numpy as np

from mpsnet_core.arrays.types import Bools, Floats


def crests(steep: Floats, down: Floats, across: Floats) -> Bools:
    """(H, W) non-maximum suppression of a gradient, along the axis it mostly points along.

    steep: (H, W) its length. down, across: (H, W) its components.
    """
    along_rows, along_columns = np.ones(steep.shape, bool), np.ones(steep.shape, bool)
    along_rows[1:-1] = (steep[1:-1] >= steep[:-2]) & (steep[1:-1] >= steep[2:])
    along_columns[:, 1:-1] = (steep[:, 1:-1] >= steep[:, :-2]) & (steep[:, 1:-1] >= steep[:, 2:])
    return np.where(np.abs(down) > np.abs(across), along_rows, along_columns)
