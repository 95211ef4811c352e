"""Sheen: light scattered by a layer of fine fibres on the surface, as on cloth and dust.

Zeltner, Burley and Chiang, "Practical Multiple-Scattering Sheen Using Linearly Transformed Cosines", SIGGRAPH 2022
talks. Cycles uses the authors' tables of the transform; this is MaterialX's closed form, which is fitted to them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Sheen:
    """Sheen of one roughness at K view cosines: a cosine lobe, stretched by `spread`, sheared by `shear` and scaled."""

    albedo: NDArray[np.float64]
    """(K,) float64. Directional albedo, which scales the lobe, 0 to 1."""
    spread: NDArray[np.float64]
    """(K,) float64. Stretch of the lobe."""
    shear: NDArray[np.float64]
    """(K,) float64. Shear of the lobe."""


def sheen(roughness: float, cosines: NDArray[np.float64]) -> Sheen:
    """The sheen layer of a roughness from 0 to 1, seen at `cosines` (K,)."""
    # The fits are not valid for smaller roughness.
    x, y = cosines, min(max(roughness, 0.01), 1.0)
    width = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    middle = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    floor = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    albedo = np.exp(-0.5 * ((x - middle) / width) ** 2) / (width * np.sqrt(2 * np.pi)) + floor
    spread = (2.58126 * x + 0.813703 * y) * y / (1 + 0.310327 * x * x + 2.60994 * x * y)
    shear = np.sqrt(1 - x) * (y - 1) * y**3 / (0.0000254053 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y)
    return Sheen(albedo.clip(0, 1), spread, shear)


def sheen_lobe(
    spread: NDArray[np.float32],
    shear: NDArray[np.float32],
    cos_light: NDArray[np.float32],
    cos_view: NDArray[np.float32],
    cos_between: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Reflectance (N,) in 1/sr of a sheen layer of albedo 1. cos_between: of the angle between light and viewer."""
    sine = np.sqrt(np.maximum(1 - cos_view * cos_view, 1e-12))
    towards_view = (cos_between - cos_light * cos_view) / sine
    length = spread * spread * (1 - cos_light * cos_light)
    length += cos_light * (2 * spread * shear * towards_view + (shear * shear + 1) * cos_light)
    lobe = np.square(spread / np.maximum(length, 1e-6)) / np.float32(np.pi)
    return np.asarray(lobe, np.float32)
