"""Whether a white photo shows the same scene as its photo, by their edges, whatever lamp lit it.

Creases, outlines and borders of paint are steep in each of the photo's three lights, and in the white photo, at the
same pixels. In a white photo of another object or pose they are elsewhere: it agrees no better with the photo than when
it is shifted.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.resampling import block_means

# The object's size, in pixels, to which both photos are reduced: noise averages out.
SIDE = 192
# The shift that edges are compared at, as a fraction of the object's size.
SHIFT = 0.05
# The photo's own lights must agree on edges by this much for its edges to tell anything; smooth objects' differ.
TELLING = 0.04
# A white photo that agrees with the photo less than this share of what the photo's lights agree does not fit.
# In right ones it is 1.2 to 7 times as much, in others 0.3 or less.
SHARE = 0.3
DARKEST = 0.03  # of the 99th percentile


def shows_another_scene(
    photo: NDArray[np.floating[Any]], white: NDArray[np.floating[Any]], mask: NDArray[np.bool_]
) -> bool:
    """Whether a white photo (H, W, 3) has its edges elsewhere than the photo (H, W, 3); False where there are none."""
    box = bounding_box(mask)
    factor = max(1, round(np.sqrt(np.count_nonzero(mask)) / SIDE))
    inside = block_means(mask[box][..., None].astype(np.float32), factor)[..., 0] > 0.99
    shift = max(3, round(SHIFT * np.sqrt(np.count_nonzero(inside))))
    shifts = [(down, right) for down in (-shift, 0, shift) for right in (-shift, 0, shift)]
    inner = np.pad(inside, shift)
    inner = np.logical_and.reduce([np.roll(inner, by, (0, 1)) for by in shifts])[shift:-shift, shift:-shift]
    if np.count_nonzero(inner) < SIDE:
        return False
    lights = np.moveaxis(block_means(np.where(mask[box][..., None], photo[box], 0), factor), -1, 0)
    whole = block_means(np.where(mask[box][..., None], white[box], 0), factor).mean(axis=-1)
    *own, other = (_steepness(values, inside, inner) for values in (*lights, whole))

    def agreement(one: NDArray[np.float64], two: NDArray[np.float64]) -> float:
        """How much better two pictures' edges correlate in place than shifted."""
        found = {by: float(np.corrcoef(one[inner], np.roll(two, by, (0, 1))[inner])[0, 1]) for by in shifts}
        return found.pop((0, 0)) - max(found.values())

    among = np.mean([agreement(own[one], own[two]) for one, two in ((0, 1), (0, 2), (1, 2))])
    return bool(among > TELLING and np.mean([agreement(one, other) for one in own]) < SHARE * among)


def _steepness(values: NDArray[np.float32], inside: NDArray[np.bool_], inner: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(h, w) the slope of the logarithm, in which shading and paint add up; outliers are cut."""
    lowest = max(DARKEST * float(np.percentile(values[inside], 99)), 1e-12)
    slope = np.hypot(*np.gradient(np.log(np.maximum(values.astype(np.float64), lowest))))
    return np.asarray(np.minimum(slope, np.percentile(slope[inner], 99)))
