"""Gradients: how a height changes along a picture's columns and rows. Unlike normals they can be added and averaged."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised

# The tangent of 79°: what is steeper is hardly seen, and one such pixel would weigh as much as many others. They are
# averaged unweighted, so this limit is lower than that of heights before a camera (gradients.LEAST_FACING, 87°), whose
# steep pixels count less.
STEEPEST = 5.0


def gradients_of(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., 2) height per length along columns (to the right) and along rows (downwards), of normals (..., 3).

    Those steeper than STEEPEST are limited to it.
    """
    facing = np.maximum(normals[..., 2:], 1 / STEEPEST)
    gradients = normals[..., :2] / facing * np.array([-1, 1], np.float32)
    steep = np.maximum(np.linalg.norm(gradients, axis=-1, keepdims=True) / STEEPEST, 1)
    limited: NDArray[np.float32] = (gradients / steep).astype(np.float32)
    return limited


def normals_of(gradients: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., 3) unit normals, x right, y up, z towards the camera, of gradients (..., 2); as :func:`gradients_of`."""
    columns, rows = np.moveaxis(gradients, -1, 0)
    return normalised(np.stack([-columns, rows, np.ones_like(rows)], axis=-1).astype(np.float32))
