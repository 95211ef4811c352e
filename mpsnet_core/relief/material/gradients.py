"""Gradients of heights along an image's columns and rows. Unlike normals, they can be added and averaged."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised

# The tangent of 79°. Steeper surfaces are hardly visible, and one such pixel would dominate a mean. Means here are
# unweighted, so this limit is lower than that of integration (gradients.MIN_FACING, 87°), where steep pixels have
# less weight.
STEEPEST = 5.0


def gradients_of(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., 2) height per length to the right and downwards, from normals (..., 3), limited to STEEPEST."""
    facing = np.maximum(normals[..., 2:], 1 / STEEPEST)
    gradients = normals[..., :2] / facing * np.array([-1, 1], np.float32)
    steep = np.maximum(np.linalg.norm(gradients, axis=-1, keepdims=True) / STEEPEST, 1)
    limited: NDArray[np.float32] = (gradients / steep).astype(np.float32)
    return limited


def normals_of(gradients: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., 3) unit normals, x right, y up, z towards the camera, from gradients (..., 2) of :func:`gradients_of`."""
    columns, rows = np.moveaxis(gradients, -1, 0)
    return normalised(np.stack([-columns, rows, np.ones_like(rows)], axis=-1).astype(np.float32))
