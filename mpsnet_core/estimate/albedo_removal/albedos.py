"""Albedo of each pixel given estimated normals, and photos divided by it."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F64, Bools, Floats
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in
from mpsnet_core.scene.normal_map import NormalMap

SAMPLED = 20_000  # pixels of a large photo
MIN_PIXELS = 200  # with fewer, the surface's colours cannot be found
GRAZING = 0.1  # a cosine; below, a light shows little of the albedo
DARKEST = 1e-30  # keeps logarithms finite
# Rows at a time; intermediate arrays take some hundred bytes a pixel.
ROWS = 32


class Pixels(NamedTuple):
    """Pixels (...) of a photo."""

    light: Floats
    """(..., 3). Unmixed image."""
    lights: F64
    """(..., 3, 3). Light directions times brightness, one light per row."""
    cosines: Floats
    """(..., 3). `lights` times the estimated normals."""
    grazing: Floats
    """(..., 3). Limits of the cosines below which a light grazes the surface."""

    @property
    def log_albedos(self) -> Floats:
        """(..., 3) logarithm of the albedo by each light; too dark where a light grazes the surface."""
        return np.log(np.maximum(self.light, DARKEST) / np.maximum(self.cosines, self.grazing))


def pixels_in(capture: Capture, normals: NormalMap, rows: slice) -> Pixels:
    """Rows of a photo, with its estimated normals in camera space."""
    light = capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))
    lights = lights_in(capture, rows)
    cosines = np.einsum("...ki,...i->...k", lights, normals.vectors[rows].astype(np.float32))
    return Pixels(light, lights, cosines, GRAZING * np.linalg.norm(lights, axis=-1))


def valid_in(capture: Capture, pixels: Pixels, rows: slice) -> Bools:
    """(h, W) pixels inside the mask, not clipped, and lit by all three lights in both normals and photo."""
    reached = (pixels.light > 0).all(axis=-1) & (pixels.cosines > pixels.grazing).all(axis=-1)
    return reached & capture.mask[rows] & ~capture.saturated_in(rows).any(axis=-1)


def divide_out_albedo(capture: Capture, factors: Callable[[slice], tuple[Floats, Floats]]) -> Capture:
    """The unmixed capture divided by the albedo.

    factors: for a slice of rows, returns the unmixed image (h, W, 3) and its divisor, (h, W, 3) or (h, W, 1).
    """
    image = np.zeros_like(capture.image)
    largest = np.finfo(image.dtype).max  # 65504 for half floats

    def divide(rows: slice) -> None:
        light, albedo = factors(rows)
        image[rows] = np.where(capture.mask[rows, :, None], np.clip(light / albedo, -largest, largest), 0)

    on_all_cores(divide, bands(len(image), ROWS))
    rig = replace(capture.rig, mixing=np.eye(3))
    return replace(capture, image=image, rig=rig, clip=np.inf, clipped=capture.saturated_lights)
