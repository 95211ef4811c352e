"""Detect ambient light: surfaces that face away from a light, but are still bright in its channel."""

import logging

import numpy as np

from mpsnet_core.arrays.mask_regions import eroded
from mpsnet_core.arrays.orientation import blocks_of, is_round, orientation_measures
from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.scene.normal_map import NormalMap

log = logging.getLogger(__name__)

RIGHT_ANGLE = np.float32(np.pi / 2)
# A normal certainly faces away from a light if it does so by more than its expected error plus this, in radians.
BEYOND = np.float32(np.radians(3))
# Pixels above this cosine show how bright a light is.
LIT = 0.3
# Highest brightness of attached shadows, as a share of the light's, without a warning. 15 materials rendered by Cycles,
# wax and skin among them, had 0.00; with 3%, 10% and 30% of ambient light 0.01 to 0.03, 0.02 to 0.09 and 0.04 to 0.27.
SHADOW = 0.05
# The same at the outline, of which a part may face the light after all: DiLiGenT's ball and cat, 16 choices of lights,
# had up to 0.07; with 10% of ambient light 0.08 or more, or too little leaned outwards to tell.
SHADOW_AT_RIM = 0.08
# Pixels at the outline show the background, too.
OUTLINE = 2
# Pixels of a large photo to sample; least number of shadow pixels, absolute and as a share of the object.
SAMPLED, MIN_PIXELS, MIN_SHARE = 200_000, 30, 0.001
# Least number of blocks at the outline that face away from a light.
MIN_BLOCKS = 10
# Fraction of the outline that leans outwards as far as is believed of all of it: ambient light raises the rest.
LEANING = 0.25
# Fraction of the outline in shadow that is at least as dark as is believed: not all of it faces away.
DARKEST = 0.2


def warn_of_ambient_light(capture: Capture, normals: NormalMap) -> None:
    """Warn if shadows are so bright that ambient light misleads every model.

    There is no warning for a shallow relief, which has no attached shadows, and under near lights. Normals by equation
    2 never face away from a light that is bright in its channel: then the outline of a round object tells.
    """
    share, most = shadow_brightness(capture, normals), SHADOW
    if share is None:
        share, most = rim_brightness(capture, normals), SHADOW_AT_RIM
    if share is not None and share > most:
        words = "where a light cannot reach the object, its channel still shows %.0f%% of it, which makes normals "
        words += "flatter: light comes from elsewhere, or the rig is wrong about where the lights stand or how their "
        words += "colours mix; darken the room, or give a photo with the three lights off with --dark [room-light]"
        log.warning(words, 100 * share)


def shadow_brightness(capture: Capture, normals: NormalMap) -> float | None:
    """Median brightness of a light's channel where the surface faces away from the light, as a share of its brightness
    where the surface faces it. None if too few pixels certainly face away."""
    if capture.rig.near is not None:
        return None
    step = grid_step(int(np.count_nonzero(capture.mask)), SAMPLED)
    every = (slice(None, None, step), slice(None, None, step))
    mask, inner = capture.mask[every], eroded(capture.mask, OUTLINE)[every]
    light = capture.rig.unmixed(capture.image[every].astype(np.float32, copy=False))
    cosines = normals.vectors[every].astype(np.float32) @ capture.rig.directions.T.astype(np.float32)
    expected = (1 - normals.confidence[every].astype(np.float32)) * RIGHT_ANGLE
    away = cosines < -np.sin(np.minimum(expected + BEYOND, RIGHT_ANGLE))[..., None]
    shares = []
    for number in range(3):
        lit, dark = mask & (cosines[..., number] > LIT), inner & away[..., number]
        full = np.median(light[..., number][lit] / cosines[..., number][lit]) if lit.any() else 0
        if full > 0:
            shares.append(light[..., number][dark] / full)
    found = np.concatenate(shares) if shares else np.empty(0)
    enough = len(found) >= max(MIN_PIXELS, MIN_SHARE * np.count_nonzero(mask))
    return float(np.median(found)) if enough else None


def rim_brightness(capture: Capture, normals: NormalMap) -> float | None:
    """As :func:`shadow_brightness`, at the outline of a round object alone, where the surface faces outwards.

    The normals all around show how far it does. None if the object may not be round.
    """
    vectors, photo = blocks_of(normals.vectors, capture.mask), blocks_of(capture.image, capture.mask)
    if capture.rig.near is not None or vectors is None or photo is None:
        return None
    unit, rim = normalised(vectors.values), vectors.outline.rim
    if not is_round(orientation_measures(unit, vectors.whole, vectors.outline)[0]):
        return None
    z = float(np.quantile(unit[rim, 2], LEANING))
    outwards = np.concatenate([np.sqrt(1 - z**2) * vectors.outline.outwards[rim], np.full((rim.sum(), 1), z)], axis=1)
    light = capture.rig.unmixed(photo.values)
    facing = unit @ capture.rig.directions.T
    shares = []
    for number, direction in enumerate(capture.rig.directions):
        lit, dark = vectors.whole & (facing[..., number] > LIT), outwards @ direction < -np.sin(BEYOND)
        if lit.any() and dark.sum() >= MIN_BLOCKS:
            full = np.median(light[..., number][lit] / facing[..., number][lit])
            shares.append(np.quantile(light[..., number][rim][dark], DARKEST) / full)
    return float(max(shares)) if shares else None
