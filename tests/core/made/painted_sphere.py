"""A painted sphere, and photos of it."""

import numpy as np
from synthetic import CROSSTALK, degrees_between, shaded_sphere

from mpsnet_core import Capture, LightRig, estimate_normals, published_rig

MIXED = LightRig(published_rig().directions, np.array(CROSSTALK))

GAINS = np.array([0.4, 1.0, 1.9])  # of the white photo, which no one knows


class Painted:
    """A matt sphere of three strong colours, of which a band lies in the first light's shadow.

    narrow: whether the surface reflects each light by one albedo, and not each channel.
    """

    def __init__(self, rig: LightRig = MIXED, size: int = 96, narrow: bool = False, colours: int = 3) -> None:
        self.sphere = shaded_sphere(size)
        rows, columns = np.mgrid[:size, :size]
        paints = np.array([[0.7, 0.06, 0.05], [0.05, 0.4, 0.1], [0.8, 0.6, 0.05]])
        self.albedo = paints[(rows // 11 + columns // 17) % colours] * self.sphere.mask[..., None]
        self.light = np.maximum(self.sphere.normals @ rig.directions.T, 0)
        self.light[size // 2 : size // 2 + 6, :, 0] = 0
        self.lit = self.sphere.mask & (self.light > 0.02).all(axis=-1)
        total = self.light.sum(axis=-1, keepdims=True)
        if narrow:
            image, white = (self.albedo * self.light) @ rig.mixing.T, (self.albedo * total * GAINS) @ rig.mixing.T
        else:
            image, white = self.albedo * (self.light @ rig.mixing.T), self.albedo * total * GAINS
        self.capture = Capture(image, self.sphere.mask, rig, white=white)

    def off(self, capture: Capture, where: np.ndarray) -> np.ndarray:
        """Degrees by which equation 2 is wrong."""
        normals = estimate_normals(capture, "lambertian").vectors
        return degrees_between(normals, self.sphere.normals)[where]
