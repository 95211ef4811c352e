"""Decide whether a photo without a stated encoding is linear or sRGB: which of the two gives integrable normals."""

import logging
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from mpsnet_core.arrays.gradient_derivatives import gradient_derivatives
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.io.image import Assumed, linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.scene.rig_check import equal_albedo

log = logging.getLogger(__name__)

T = TypeVar("T")

# The encodings in words.
WORDS: dict[Assumed, str] = {"srgb": "sRGB", "linear": "linear"}
# Number of photos of a set to examine.
EXAMINED = 5

# Above DECIDED, values are taken as linear; above CLOSE, there is a warning. Tested on 1,320 real and synthetic photos
# with paint, gloss, shadows, noise and inaccurate rigs: stored as sRGB, 1 was above DECIDED and 46 above CLOSE; stored
# as linear, 223 and 590.
DECIDED = 0.3
CLOSE = 0.1
# Range of the stored values to use: brighter than shadows, darker than clipped pixels.
DARKEST, BRIGHTEST = 0.12, 0.97
# The object is divided into blocks: number along the side of a square of its area; pixels to use along a block's side.
BLOCKS = 40
BLOCK_PIXELS = 6
MIN_BLOCKS = 150
MIN_CELLS = 100
# Normals with a smaller z have no reliable gradients.
MIN_FACING = 0.15


def photos_to_examine(sources: Sequence[T]) -> list[T]:
    """The photos of a set by which its encoding is decided: all of a small set, some evenly spread over a large one."""
    places = np.linspace(0, len(sources) - 1, min(EXAMINED, len(sources))).round().astype(int)
    return [sources[place] for place in places]


def other_encoding(assumed: Assumed) -> Assumed:
    """The other encoding."""
    return "linear" if assumed == "srgb" else "srgb"


def warn_of_transfer_curve(name: str, assumed: Assumed, *, decided: bool) -> None:
    """Warn of a file without a stated encoding: that it was `decided` to have the other one, or may have it."""
    other = other_encoding(assumed)
    usual, likely = WORDS[assumed], "sRGB" if other == "srgb" else "LINEAR"
    if decided:
        log.warning(
            "%s does not state its colour encoding and was READ AS %s, because read as %s its normals would fit no "
            "single surface; if it is %s, set the encoding to %s (--encoding %s) [transfer-curve]",
            *(name, likely, usual, usual, assumed, assumed),
        )
    else:
        log.warning(
            "%s does not state its colour encoding and was read as %s, but MAY BE %s; if so, set the encoding to %s "
            "(--encoding %s): the wrong curve turns normals by ten degrees and more [transfer-curve]",
            *(name, usual, likely, other, other),
        )


def evidence_for_linear(pixels: Floats, mask: Bools, rig: LightRig, *, as_srgb: bool = True) -> float:
    """Evidence that a photo's file holds linear values, not sRGB ones; above 0 linear is likelier.

    pixels: (H, W, 3) linearised by the sRGB curve, whether or not that was right; without `as_srgb` as stored. Returns
    0 if too few are usable.

    The gradient field of a surface has no curl. A wrong curve distorts equation 2's normals, and their gradients get
    curl. Brighter or darker paint does not change these normals. The evidence is the logarithm of the ratio of both
    curls, sRGB over linear, each as a share of all second derivatives.
    """
    if rig.near is not None:
        return 0.0
    side = np.sqrt(np.count_nonzero(mask)) / BLOCKS
    thin = max(1, int(side / BLOCK_PIXELS))
    pixels, mask = pixels[::thin, ::thin], mask[::thin, ::thin]
    block = max(1, round(side / thin))
    stored = linear_to_srgb(pixels) if as_srgb else pixels.astype(np.float32, copy=False)
    usable = mask & (stored.min(axis=-1) > DARKEST) & (stored.max(axis=-1) < BRIGHTEST)
    unmixing = np.linalg.inv(rig.mixing).T.astype(np.float32)
    by_srgb, by_linear = (
        _curl((values @ unmixing).astype(np.float32, copy=False), usable, block, rig)
        for values in (srgb_to_linear(stored), stored)
    )
    return float(np.log(by_srgb / by_linear)) if by_srgb and by_linear else 0.0


def _curl(pixels: F32, usable: Bools, block: int, rig: LightRig) -> float:
    """Mean curl of equation 2's gradients, as a share of all their derivatives; 0 if too few pixels are usable.

    pixels: (H, W, 3) unmixed. usable: (H, W). block: side of the blocks to average, in pixels.
    """
    usable = usable & (pixels > 0).all(axis=-1)
    whole = block_means(usable[..., None].astype(np.float32), block)[..., 0] > 0.999
    if np.count_nonzero(whole) < MIN_BLOCKS:
        return 0.0
    colours = block_means(np.where(usable[..., None], pixels, 0), block).astype(np.float64)
    scaled = colours * equal_albedo(colours[whole], rig.directions)
    normals = scaled @ np.linalg.inv(rig.directions).T
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    along_x, along_y = gradient_derivatives(normals, whole, MIN_FACING)
    if len(along_x) < MIN_CELLS:
        return 0.0
    curl = np.abs(along_y[:, 0] - along_x[:, 1])
    all_of_it = np.sqrt(np.square(along_x).sum(axis=-1) + np.square(along_y).sum(axis=-1))
    return float(np.mean(curl / (all_of_it + 0.1 * np.median(all_of_it) + 1e-12)))
