"""Decide whether a photo without a stated encoding is linear or sRGB: which of the two gives integrable normals."""

import logging

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.block_means import block_means
from mpsnet_core.arrays.gradient_derivatives import gradient_derivatives
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

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
ROUNDS = 15
# Weight of the prior that the lights are equally strong.
STRENGTH_PRIOR = 0.05


def is_taken_as_linear(name: str, image: Image, mask: NDArray[np.bool_], rig: LightRig) -> bool:
    """Whether to read a file without a stated encoding as linear instead of sRGB. Warns if it is, or may be, linear.

    image: as read, without correction.
    """
    rather = _evidence(image, mask, rig)
    if rather > DECIDED:
        log.warning(
            "%s does not state its colour encoding and was READ AS LINEAR, because read as sRGB its normals "
            "would fit no single surface; if it is sRGB, set the encoding to srgb (--encoding srgb) "
            "[transfer-curve]",
            name,
        )
        return True
    _warn(name, rather)
    return False


def warn_of_doubtful_curve(name: str, image: Image, mask: NDArray[np.bool_], rig: LightRig) -> None:
    """Warn if a file without a stated encoding, read as sRGB, may be linear. image: without correction."""
    _warn(name, _evidence(image, mask, rig))


def _evidence(image: Image, mask: NDArray[np.bool_], rig: LightRig) -> float:
    return evidence_for_linear(image.pixels, mask, rig) if image.assumed else 0.0


def _warn(name: str, rather: float) -> None:
    if rather > CLOSE:
        log.warning(
            "%s does not state its colour encoding and was read as sRGB, but MAY BE LINEAR; if so, set the "
            "encoding to linear (--encoding linear): the wrong curve turns normals by ten degrees and more "
            "[transfer-curve]",
            name,
        )


def evidence_for_linear(pixels: NDArray[np.float32], mask: NDArray[np.bool_], rig: LightRig) -> float:
    """Evidence that a photo's file holds linear values, not sRGB ones; above 0 linear is likelier.

    pixels: (H, W, 3) linearised by the sRGB curve, whether or not that was right. Returns 0 if too few are usable.

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
    stored = linear_to_srgb(pixels)
    usable = mask & (stored.min(axis=-1) > DARKEST) & (stored.max(axis=-1) < BRIGHTEST)
    unmixing = np.linalg.inv(rig.mixing).T.astype(np.float32)
    as_srgb, as_linear = (
        _curl((values @ unmixing).astype(np.float32, copy=False), usable, block, rig)
        for values in (srgb_to_linear(stored), stored)
    )
    return float(np.log(as_srgb / as_linear)) if as_srgb and as_linear else 0.0


def _curl(pixels: NDArray[np.float32], usable: NDArray[np.bool_], block: int, rig: LightRig) -> float:
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


def equal_albedo(colours: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) factors of colours (P, 3) that make their albedo by equation 2 as constant as possible.

    directions: (3, 3) one light per row. The factors compensate for the unknown strengths of the lights, which would
    distort the normals.
    """
    means = np.median(colours, axis=0)
    square = np.linalg.inv(directions @ directions.T)
    strengths = np.zeros(3)
    for _ in range(ROUNDS):
        lights = colours / means * np.exp(strengths)
        turned = lights @ square
        length = dot(turned, lights)
        error = np.log(length) / 2
        weight = 1 / np.maximum(np.abs(error - np.median(error)), 0.02)
        weight /= weight.sum()
        jacobian = turned * lights / length[:, None]
        jacobian, error = jacobian - weight @ jacobian, error - weight @ error
        left = (jacobian * weight[:, None]).T @ jacobian + STRENGTH_PRIOR * np.eye(3)
        strengths = strengths - np.linalg.solve(left, jacobian.T @ (weight * error) + STRENGTH_PRIOR * strengths)
    return np.asarray(np.exp(strengths) / means)
