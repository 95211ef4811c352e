"""Whether a photo's values are linear or sRGB, where its file does not say: by how well three lights explain either."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.images import linear_to_srgb
from mpsnet_core.rig import LightRig

# Paint alone varies 2.2 times as much in the wrong reading, whichever that is: more than this is told by the shading.
CLEAR = 3.0
# Stored values that are used: above shadows, below what clips.
DARKEST, BRIGHTEST = 0.12, 0.97
LEAST_PIXELS = 500
MOST_PIXELS = 20_000
ROUNDS = 15
# How little the lights' strengths are taken to differ, against what the pixels say.
STRENGTH_PRIOR = 0.05
LEAST_SPREAD = 1e-3


def linear_rather(pixels: NDArray[np.float32], mask: NDArray[np.bool_], rig: LightRig) -> float:
    """How many times better the three lights explain a photo whose file holds linear values, not sRGB ones.

    pixels: (H, W, 3) linear by the sRGB curve. 1 where too few pixels tell. Above CLEAR it is clear for matt surfaces
    and glossy ones; below, paint may say as much.
    """
    inside = pixels[mask]
    stored = linear_to_srgb(inside[:: max(1, len(inside) // MOST_PIXELS)]).astype(np.float64)
    stored = stored[(stored.min(axis=1) > DARKEST) & (stored.max(axis=1) < BRIGHTEST)]
    if len(stored) < LEAST_PIXELS:
        return 1.0
    taken = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    return _spread(taken, rig) / _spread(stored, rig)


def _spread(colours: NDArray[np.float64], rig: LightRig) -> float:
    """How much the albedo by equation 2 differs over pixels (P, 3), as the median deviation of its logarithm.

    It is constant where there is one paint, and the lights' strengths, which are not known, are put right for that.
    """
    colours = colours @ np.linalg.inv(rig.mixing).T
    colours = colours[(colours > 0).all(axis=1)]
    if len(colours) < LEAST_PIXELS:
        return 1.0
    colours = colours / colours.mean(axis=0)
    square = np.linalg.inv(rig.directions @ rig.directions.T)
    strengths = np.zeros(3)
    for _ in range(ROUNDS):
        lights = colours * np.exp(strengths)
        turned = lights @ square
        length = np.einsum("pi,pi->p", turned, lights)
        error = np.log(length) / 2
        weight = 1 / np.maximum(np.abs(error - np.median(error)), 0.02)
        weight /= weight.sum()
        slope = turned * lights / length[:, None]
        slope, error = slope - weight @ slope, error - weight @ error
        left = (slope * weight[:, None]).T @ slope + STRENGTH_PRIOR * np.eye(3)
        strengths = strengths - np.linalg.solve(left, slope.T @ (weight * error) + STRENGTH_PRIOR * strengths)
    return max(float(np.median(np.abs(error - np.median(error)))), LEAST_SPREAD)
