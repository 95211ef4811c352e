"""Shifted gamma reflectance with the parameters fitted to MERL: other people's fits by another model, to compare with.

Bagher, Soler and Holzschuch, "Accurate fitting of measured reflectances using a Shifted Gamma micro-facet
distribution", Computer Graphics Forum 2012. Written out in angles and double precision, on its own.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShiftedGamma:
    """Parameters, (3,) each for R, G and B, named as in the paper."""

    rhoD: Array
    rhoS: Array
    alpha: Array
    p: Array
    f0: Array
    f1: Array
    kap: Array
    lambda_: Array
    c: Array
    k: Array
    theta0: Array

    def __call__(self, normals: Array, lights: Array, views: Array) -> Array:
        """BRDF without the cosine, (N, 3) in 1/sr, for directions above the surface."""
        half = lights + views
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        cos_half, cos_difference, cos_light, cos_view = (
            np.clip((a * b).sum(axis=1), 0, 1)[:, None]
            for a, b in ((normals, half), (half, lights), (normals, lights), (normals, views))
        )
        specular = self._fresnel(cos_difference) * self._distribution(cos_half)
        specular = specular * self._masking(cos_light) * self._masking(cos_view) / (cos_light * cos_view)
        return (self.rhoD + self.rhoS * specular) / np.pi

    def _distribution(self, cos_half: Array) -> Array:
        slope = 1 / cos_half**2 - 1
        shifted = self.alpha + slope / self.alpha
        return self.kap * np.exp(-shifted) / (shifted**self.p * np.pi * cos_half**4)

    def _masking(self, cosine: Array) -> Array:
        beyond = np.maximum(np.arccos(cosine) - self.theta0, 0)
        with np.errstate(over="ignore"):
            return np.clip(1 + self.lambda_ * (1 - np.exp(self.c * beyond**self.k)), 0, 1)

    def _fresnel(self, cosine: Array) -> Array:
        return self.f0 - cosine * self.f1 + (1 - self.f0) * (1 - cosine) ** 5


def read_shifted_gamma(path: Path) -> dict[str, ShiftedGamma]:
    names = [name.rstrip("_") for name in ShiftedGamma.__dataclass_fields__]
    with path.open(newline="") as file:
        return {
            row["name"]: ShiftedGamma(*(np.array([float(row[f"{name}_{c}"]) for c in "rgb"]) for name in names))
            for row in csv.DictReader(file)
        }
