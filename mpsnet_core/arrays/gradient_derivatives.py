"""Derivatives of a surface's gradients. If their curl is zero, the normals are integrable to a surface."""

import numpy as np

from mpsnet_core.arrays.types import Bools, Floats


def gradient_derivatives(normals: Floats, usable: Bools, min_facing: float) -> tuple[Floats, Floats]:
    """Derivatives of the gradients along x, (N, 2), and along y, (N, 2), in all cells of four usable pixels.

    normals: (H, W, 3) unit vectors. Those with z up to `min_facing` have no reliable gradients and are left out.
    Gradients of steep surfaces are large, so the derivatives are multiplied by the square of z.
    """
    usable = usable & (normals[..., 2] > min_facing)
    facing = np.maximum(normals[..., 2:], min_facing)
    gradients = -normals[..., :2] / facing
    corners = [gradients[:-1, :-1], gradients[:-1, 1:], gradients[1:, :-1], gradients[1:, 1:]]
    along_x = (corners[1] + corners[3] - corners[0] - corners[2]) / 2
    along_y = (corners[0] + corners[1] - corners[2] - corners[3]) / 2
    cells = usable[:-1, :-1] & usable[:-1, 1:] & usable[1:, :-1] & usable[1:, 1:]
    level = facing[1:, 1:][cells] ** 2
    return along_x[cells] * level, along_y[cells] * level
