"""The baseline: equation 2 of the paper, initial normals from three lights and a matt surface."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.distant_lights import under_distant_lights
from mpsnet_core.scene.normal_map import NormalMap

# Below this share of its channel's 99th percentile inside the mask a pixel counts as unlit by that channel's light.
SHADOW_SHARE = 0.02


def divided(image: NDArray[np.float32], means: NDArray[np.float64] | float) -> NDArray[np.float32]:
    """The image (..., 3) divided by its mean, or each channel by its own; by 1 where the mean is not above 0."""
    divisor: NDArray[np.float32] = np.where(np.greater(means, 0), means, 1).astype(np.float32)
    return image / divisor


def initial_normals(image: NDArray[np.float32], directions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Equation 2: ``n = L⁻¹ c``, normalised.

    image: (..., 3) linear, one channel a light. directions: (3, 3), a unit vector a row. Returns (..., 3) unit
    vectors in the directions' frame; a black pixel faces the camera (+z).
    """
    return normalised(image @ np.linalg.inv(directions).T.astype(np.float32))


def usable_channels(capture: Capture) -> NDArray[np.bool_]:
    """(H, W, 3) False where a light does not reach the pixel (shadow) or its channel is saturated."""
    saturated = capture.saturated
    if not np.array_equal(capture.rig.mixing, np.eye(3)):
        # Unmixing computes each light from all channels, so one saturated channel spoils all three.
        saturated = np.broadcast_to(saturated.any(axis=-1, keepdims=True), saturated.shape)
    light = capture.rig.unmixed(capture.image)
    lit: NDArray[np.bool_] = light > SHADOW_SHARE * np.percentile(light[capture.mask], 99, axis=0)
    return lit & ~saturated


def lambertian_normals(capture: Capture, grey_world: bool = False) -> NormalMap:
    """Normals by equation 2, with or without grey-world. Confidence is the share of usable channels (0, ⅓, ⅔, 1).

    Under near lights every pixel has its own three. Perspective makes no difference: a matt surface looks the same from
    all sides.
    """
    distant = under_distant_lights(capture)
    image = distant.rig.unmixed(distant.image)
    if grey_world:
        image = divided(image, image[capture.mask].mean(axis=0, dtype=np.float64))
    confidence = usable_channels(capture).mean(axis=-1, dtype=np.float32)
    return NormalMap(initial_normals(image, capture.rig.directions), capture.mask, confidence)
