"""The error of equation 2 of the MPS-Net paper on a material, caused by its colour and its gloss."""

from functools import lru_cache

import numpy as np

from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.estimate.features import initial_normals
from mpsnet_core.scene.rig import published_rig
from mpsnet_core.synthesis.reflectance import Reflectance, load_reflectance, material_names
from mpsnet_core.synthesis.scene_description import Material

# The paper's images: a channel is 5/9 of its own colour and 2/9 of each of the other two.
PUBLISHED_MIXING = np.full((3, 3), 2 / 9) + np.eye(3) * (5 / 9 - 2 / 9)
SIDE = 41  # pixels of the image of a sphere


def lambertian_error(reflectance: Reflectance) -> float:
    """Mean angular error in degrees over a sphere under the paper's rig and mixing, where all three lights reach."""
    lights = published_rig().directions
    y, x = np.mgrid[-1 : 1 : SIDE * 1j, -1 : 1 : SIDE * 1j].reshape(2, -1)
    front = x * x + y * y < 0.98
    normals = np.stack([x, y, np.sqrt(np.where(front, 1 - x * x - y * y, 0))], axis=1)[front]
    normals = normals[(normals @ lights.T > 0).all(axis=1)]
    views = np.broadcast_to([0.0, 0.0, 1.0], normals.shape)
    channels = [
        reflectance(normals, np.broadcast_to(light, normals.shape), views) * (normals @ light)[:, None] @ weights
        for light, weights in zip(lights, PUBLISHED_MIXING, strict=True)
    ]
    found = initial_normals(np.stack(channels, axis=1), lights)
    return float(angular_error(found, normals).mean())


@lru_cache(maxsize=8)
def measured_errors(merl: str) -> dict[str, float]:
    """The error of equation 2 on each measured material. merl: as in `load_reflectance`."""
    return {
        source: lambertian_error(load_reflectance(Material(kind=kind, source=source), merl))
        for kind, source in material_names(merl)
    }
