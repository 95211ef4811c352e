"""The albedo that each pixel has by estimated normals, and a photo divided by it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in
from mpsnet_core.scene.normal_map import NormalMap

Floats = NDArray[np.floating[Any]]

SAMPLED = 20_000  # pixels of a large photo
LEAST_PIXELS = 200  # below, a photo says too little of the surface's colours
GRAZING = 0.1  # a cosine; below, a light says little of the albedo
DARKEST = 1e-30  # keeps logarithms finite
# A band of pixels takes some hundred bytes a pixel on the way.
ROWS = 32


class Pixels(NamedTuple):
    """Pixels (...) of a photo. light: (..., 3) each light alone. lights: (..., 3, 3) a light a row, its direction times
    its brightness. cosines: (..., 3) between the lights and the estimated normals, times the lights' brightness.
    grazing: (..., 3) below it a light grazes the surface."""

    light: Floats
    lights: NDArray[np.float64]
    cosines: Floats
    grazing: Floats

    @property
    def log_albedos(self) -> Floats:
        """(..., 3) logarithms of the albedo by each light; too dark where a light grazes the surface."""
        logarithms: Floats = np.log(np.maximum(self.light, DARKEST) / np.maximum(self.cosines, self.grazing))
        return logarithms


def pixels_in(capture: Capture, normals: NormalMap, rows: slice) -> Pixels:
    """Rows of a photo with its estimated normals, in camera space."""
    light = capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))
    lights = lights_in(capture, rows)
    cosines = np.einsum("...ki,...i->...k", lights, normals.vectors[rows].astype(np.float32))
    return Pixels(light, lights, cosines, GRAZING * np.linalg.norm(lights, axis=-1))


def valid_in(capture: Capture, pixels: Pixels, rows: slice) -> NDArray[np.bool_]:
    """(h, W) inside the mask, not clipped, and reached by all three lights, as estimated and as seen."""
    reached = (pixels.light > 0).all(axis=-1) & (pixels.cosines > pixels.grazing).all(axis=-1)
    valid: NDArray[np.bool_] = reached & capture.mask[rows] & ~capture.saturated_in(rows).any(axis=-1)
    return valid


def divided_by(capture: Capture, factors: Callable[[slice], tuple[Floats, Floats]]) -> Capture:
    """The capture with each light divided by the albedo.

    factors: rows to each light alone (h, W, 3), and what to divide it by, (h, W, 3) or (h, W, 1).
    """
    image = np.zeros_like(capture.image)
    largest = np.finfo(image.dtype).max  # of half floats 65504

    def divide(rows: slice) -> None:
        light, albedo = factors(rows)
        image[rows] = np.where(capture.mask[rows, :, None], np.clip(light / albedo, -largest, largest), 0)

    on_all_cores(divide, bands(len(image), ROWS))
    rig = replace(capture.rig, mixing=np.eye(3))
    return replace(capture, image=image, rig=rig, clip=np.inf, clipped=capture.saturated_lights)
