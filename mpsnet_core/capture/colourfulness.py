"""How colourful a photo is: much under coloured lights, little under white ones, whatever its white balance."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.resampling import block_means

# The photo's longer side is reduced to about this many pixels: noise averages out.
_SIDE = 256


def colourfulness(photo: NDArray[np.floating[Any]]) -> float:
    """How far a photo's channels (H, W, 3) are from multiples of each other: 0 to 3.

    Paint on the object adds to it under any light, so it can only be compared between photos of one object.
    """
    small = block_means(photo, max(1, max(photo.shape[:2]) // _SIDE)).reshape(-1, 3).astype(np.float64)
    directions = small / np.maximum(np.linalg.norm(small, axis=0), 1e-12)
    return float(3 - (directions.T @ directions)[np.triu_indices(3, 1)].sum())
