"""Light that is none of the rig's: seen where a surface turned away from a light is still bright in its channel."""

import logging

import numpy as np

from mpsnet_core.arrays.mask_regions import eroded
from mpsnet_core.arrays.sampling import grid_step
from mpsnet_core.capture.capture import Capture
from mpsnet_core.scene.normal_map import NormalMap

log = logging.getLogger(__name__)

RIGHT_ANGLE = np.float32(np.pi / 2)
# A normal is turned away from a light for certain by more than the error that is expected of it, and this, in radians.
BEYOND = np.float32(np.radians(3))
# Cosine above which a pixel shows how bright a light is.
LIT = 0.3
# What a shadow may show of a light. Of 15 materials rendered by Cycles, wax and skin too, it was 0.00; under 3%, 10%
# and 30% of ambient light 0.01 to 0.03, 0.02 to 0.09 and 0.04 to 0.27.
SHADOW = 0.05
# Pixels at the outline show the background too.
OUTLINE = 2
# Pixels of a large photo that are looked at, and of shadow that say enough: so many, and this share of the object.
SAMPLED, LEAST_PIXELS, LEAST_SHARE = 200_000, 30, 0.001


def note_room_light(capture: Capture, normals: NormalMap) -> None:
    """Warn where shadows are so bright that light from elsewhere misleads every model.

    A shallow relief has no such shadows, so nothing is said of it; nor under near lights, and by equation 2, whose
    normals never turn away from a light that its channel shows.
    """
    share = shadow_brightness(capture, normals)
    if share is not None and share > SHADOW:
        log.warning(
            "where a light cannot reach the object, its channel still shows %.0f%% of it, which makes normals flatter: "
            "light comes from elsewhere, or the rig is wrong about where the lights stand or how their colours mix; "
            "darken the room, or give a photo with the three lights off by --dark [room-light]",
            100 * share,
        )


def shadow_brightness(capture: Capture, normals: NormalMap) -> float | None:
    """What a channel shows of its light where the surface is turned away from it, as a share of what it shows where
    the surface faces the light; the median. None where too few pixels are turned away for certain."""
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
    enough = len(found) >= max(LEAST_PIXELS, LEAST_SHARE * np.count_nonzero(mask))
    return float(np.median(found)) if enough else None
