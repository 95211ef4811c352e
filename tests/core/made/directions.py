"""Random directions above a surface, and the half and difference angles by rotation, as MERL's own reader has them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hemisphere(count: int, seed: int, least_cosine: float = 0.0) -> Array:
    """(count, 3) unit vectors, uniform over the directions with z above `least_cosine`."""
    rng = np.random.Generator(np.random.PCG64(seed))
    z = least_cosine + (1 - least_cosine) * (1 - rng.random(count))
    turn = 2 * np.pi * rng.random(count)
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def up(count: int) -> Array:
    """(count, 3) normals +z."""
    return np.tile([0.0, 0.0, 1.0], (count, 1))


def rotation(seed: int) -> Array:
    """A random (3, 3) rotation."""
    rng = np.random.Generator(np.random.PCG64(seed))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.linalg.det(turn)


def angles_by_rotation(lights: Array, views: Array) -> tuple[Array, Array, Array]:
    """Half angle, difference angle and difference azimuth (-pi to pi) for the normal +z: the half vector is turned into
    the pole about z and then about y, and the light with it."""
    half = lights + views
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    theta, phi = np.arccos(half[:, 2]), np.arctan2(half[:, 1], half[:, 0])
    x, y, z = lights.T
    x, y = x * np.cos(phi) + y * np.sin(phi), y * np.cos(phi) - x * np.sin(phi)
    x, z = x * np.cos(theta) - z * np.sin(theta), z * np.cos(theta) + x * np.sin(theta)
    return theta, np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
