"""Whether a photo's values are linear or sRGB, where its file does not say: which normals are rather of one surface."""

import logging

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.block_means import block_means
from mpsnet_core.arrays.gradient_derivatives import gradient_derivatives
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Above DECIDED the values are assumed linear. 1,320 photos, photographed and synthesised, with paint, gloss, shadows,
# noise and rigs that are known badly: as sRGB 1 of them was above it, as linear 223. Above CLOSE: 46 and 590.
DECIDED = 0.3
CLOSE = 0.1
# Stored values that are used: above shadows, below what clips.
DARKEST, BRIGHTEST = 0.12, 0.97
# The object is divided into blocks, so many along the side of a square of its area; each of some pixels along its side.
BLOCKS = 40
BLOCK_PIXELS = 6
LEAST_BLOCKS = 150
LEAST_CELLS = 100
# Normals that are turned further away have no reliable gradients.
LEAST_FACING = 0.15
ROUNDS = 15
# How little the lights' strengths are assumed to differ, against what the pixels show.
STRENGTH_PRIOR = 0.05


def is_taken_as_linear(name: str, image: Image, mask: NDArray[np.bool_], rig: LightRig) -> bool:
    """Whether to read a file that does not state its encoding as linear, not as sRGB; warns where that is or may be so.

    image: as it was read, not corrected.
    """
    rather = _evidence(image, mask, rig)
    if rather > DECIDED:
        log.warning(
            "%s does not say how its values are meant, and is TAKEN AS LINEAR: as sRGB its normals would be of no one "
            "surface; if it is sRGB, set the encoding to srgb (--encoding srgb) [transfer-curve]",
            name,
        )
        return True
    _note(name, rather)
    return False


def note_doubtful_curve(name: str, image: Image, mask: NDArray[np.bool_], rig: LightRig) -> None:
    """Warn where a file that does not state its encoding, and is read as sRGB, may be linear. image: not corrected."""
    _note(name, _evidence(image, mask, rig))


def _evidence(image: Image, mask: NDArray[np.bool_], rig: LightRig) -> float:
    return evidence_for_linear(image.pixels, mask, rig) if image.assumed else 0.0


def _note(name: str, rather: float) -> None:
    if rather > CLOSE:
        log.warning(
            "%s does not say how its values are meant, is taken as sRGB, and MAY WELL BE LINEAR; then set the encoding "
            "to linear (--encoding linear): a wrong curve turns normals by ten degrees and more [transfer-curve]",
            name,
        )


def evidence_for_linear(pixels: NDArray[np.float32], mask: NDArray[np.bool_], rig: LightRig) -> float:
    """How much rather a photo's file holds linear values than sRGB ones; above 0 linear ones are likelier.

    pixels: (H, W, 3) linear by the sRGB curve, whether or not that was right. 0 where too few pixels are usable.

    The gradients of a surface have no curl, and those of the normals by equation 2 have some where values are bent by a
    wrong curve. Paint that is brighter or darker leaves these normals as they are. It is the logarithm of how many
    times as large the curl is by the sRGB curve, as a share of all second derivatives.
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
    """The mean curl of the surface's gradients by equation 2, as a share of all their derivatives; 0 if too few.

    pixels: (H, W, 3) of the lights alone, of which those count that are usable (H, W), in blocks of `block` pixels.
    """
    usable = usable & (pixels > 0).all(axis=-1)
    whole = block_means(usable[..., None].astype(np.float32), block)[..., 0] > 0.999
    if np.count_nonzero(whole) < LEAST_BLOCKS:
        return 0.0
    colours = block_means(np.where(usable[..., None], pixels, 0), block).astype(np.float64)
    scaled = colours * _strengths(colours[whole], rig)
    normals = scaled @ np.linalg.inv(rig.directions).T
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    along_x, along_y = gradient_derivatives(normals, whole, LEAST_FACING)
    if len(along_x) < LEAST_CELLS:
        return 0.0
    curl = np.abs(along_y[:, 0] - along_x[:, 1])
    all_of_it = np.sqrt(np.square(along_x).sum(axis=-1) + np.square(along_y).sum(axis=-1))
    return float(np.mean(curl / (all_of_it + 0.1 * np.median(all_of_it) + 1e-12)))


def _strengths(colours: NDArray[np.float64], rig: LightRig) -> NDArray[np.float64]:
    """(3,) what to multiply colours (P, 3) by so that their albedo by equation 2 is as constant as can be.

    The lights' strengths are not known, and by other strengths the normals are others.
    """
    means = np.median(colours, axis=0)
    square = np.linalg.inv(rig.directions @ rig.directions.T)
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
