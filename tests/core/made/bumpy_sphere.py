"""A sphere with bumps, whose heights are known."""

import numpy as np
from relief_shapes import waves, waves_gradient

AMPLITUDE = 0.04


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def bumpy_sphere(points: np.ndarray) -> np.ndarray:
    """(N, 3) normals of the sphere r = 1 + AMPLITUDE waves, in the directions of `points`."""
    p = unit(points)
    gradient = AMPLITUDE * waves_gradient(p)
    across = gradient - (gradient * p).sum(axis=1, keepdims=True) * p
    return unit((1 + AMPLITUDE * waves(p))[:, None] * p - across)
