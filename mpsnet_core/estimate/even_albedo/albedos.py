"""The albedo that each pixel has by estimated normals, and how much it counts."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sampling import grid_step
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import lights_in
from mpsnet_core.scene.normal_map import NormalMap

Floats = NDArray[np.floating[Any]]

SAMPLED = 20_000  # pixels of a large photo
GRAZING = 0.1  # a cosine; below, a light says little of the albedo
DARKEST = 1e-6


class Pixels(NamedTuple):
    """Pixels (...) of a photo. light: (..., 3) each light alone. cosines: (..., 3) between those lights, which are as
    long as they are bright, and the estimated normals. confidence: (...) of these. valid: (...) inside the mask, not
    clipped, and all three lights reach, as estimated and as seen."""

    light: Floats
    cosines: Floats
    confidence: Floats
    valid: NDArray[np.bool_]

    @property
    def log_albedos(self) -> Floats:
        """(..., 3) logarithms of the albedo by each light; too dark where a light grazes the surface."""
        logarithms: Floats = np.log(np.maximum(self.light, DARKEST) / np.maximum(self.cosines, GRAZING))
        return logarithms


def pixels_in(capture: Capture, normals: NormalMap, rows: slice) -> Pixels:
    """Rows of a photo with its estimated normals, in camera space."""
    light = capture.rig.unmixed(capture.image[rows].astype(np.float32, copy=False))
    cosines = np.einsum("...ki,...i->...k", lights_in(capture, rows), normals.vectors[rows].astype(np.float32))
    valid = capture.mask[rows] & (light > 0).all(axis=-1) & (cosines > GRAZING).all(axis=-1)
    valid &= ~capture.saturated_in(rows).any(axis=-1)
    return Pixels(light, cosines, normals.confidence[rows].astype(np.float32), valid)


def sampled(capture: Capture) -> Iterator[tuple[slice, NDArray[np.bool_]]]:
    """Bands of rows, with the pixels (h, W) of them to look at: some from all over the object."""
    step = grid_step(np.count_nonzero(capture.mask), SAMPLED)
    for rows in bands(len(capture.mask)):
        chosen = np.zeros_like(capture.mask[rows])
        chosen[-rows.start % step :: step, ::step] = True
        yield rows, chosen


def divided_by(capture: Capture, factors: Callable[[slice], tuple[Floats, Floats]]) -> Capture:
    """The capture with each light divided by the albedo.

    factors: rows to each light alone (h, W, 3), and what to divide it by, (h, W, 3) or (h, W, 1).
    """
    image = np.zeros_like(capture.image)
    for rows in bands(len(image)):
        light, albedo = factors(rows)
        image[rows] = np.where(capture.mask[rows, :, None], light / albedo, 0)
    rig = replace(capture.rig, mixing=np.eye(3))
    return replace(capture, image=image, rig=rig, clip=np.inf, clipped=capture.saturated_lights)
