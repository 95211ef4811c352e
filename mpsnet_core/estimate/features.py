"""Input features of the networks: maps made from a capture, by their names on a model's card."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture

# --- The canonical light frame: the first light nearly straight up in the image, the others counter-clockwise from it


T = TypeVar("T", bound=np.generic)

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MIRROR = np.diag([-1.0, 1.0, 1.0])
# The tilt of a light closer to the viewing axis than this (the sine of 3 degrees) is unreliable.
MIN_SINE = 0.05


@dataclass(frozen=True)
class LightFrame:
    """A change of frame for image and lights: quarter turns about the viewing axis, a reflection, reordered lights.

    No pixel is resampled. The remaining rotation of up to 45 degrees is visible to the network in the lights'
    directions.
    """

    order: tuple[int, int, int] = (0, 1, 2)
    """Indices of the rig's lights that become the first, second and third."""
    quarter_turns: int = 0
    """Number of quarter turns counter-clockwise (x towards y), as in :func:`numpy.rot90`."""
    mirrored: bool = False
    """Whether left and right are then swapped."""

    @property
    def rotation(self) -> F64:
        """(3, 3) matrix from camera space into the frame, for column vectors; a reflection if mirrored."""
        turn = np.linalg.matrix_power(QUARTER_TURN, self.quarter_turns)
        return MIRROR @ turn if self.mirrored else turn

    def lights(self, directions: F64) -> F64:
        """(3, 3) the rig's directions in the frame and in its order, one light per row."""
        return directions[list(self.order)] @ self.rotation.T

    def picture(self, values: NDArray[T]) -> NDArray[T]:
        """An image (H, W, ...) in the frame. It is a view: writing to it changes `values`."""
        turned = np.rot90(values, self.quarter_turns)
        return turned[:, ::-1] if self.mirrored else turned


CAMERA_FRAME = LightFrame()


def canonical_frames(directions: F64, passes: int = 6) -> list[LightFrame]:
    """Frames with counter-clockwise lights, sorted by how close their first light is to straight up.

    directions: (3, 3) one light per row, in camera space. passes: number of frames, 1 to 6. Each light can be the
    first, in the image and in its mirror image; the two follow one another. With lights 120° apart, the first light of
    the first two frames is at most 15° from straight up.

    Counter-clockwise is the orientation of the lights' triangle as the camera sees it. It is defined even if a light is
    on the viewing axis. Frames whose first light is on it come last.
    """
    found = []
    for mirrored in (False, True):
        seen = directions @ MIRROR if mirrored else directions
        order = [0, 1, 2] if np.linalg.det(seen) > 0 else [0, 2, 1]
        for first in range(3):
            turned = order[first], order[(first + 1) % 3], order[(first + 2) % 3]
            x, y = seen[turned[0], :2]
            turn = 90.0 - np.degrees(np.arctan2(y, x))
            # Round halves up, independent of the sign: a scene and its rotated copy must get the same frame.
            quarters = int(np.floor(round(turn / 90, 6) + 0.5))
            # The reflection comes last and reverses the sense of the rotation before it.
            frame = LightFrame(turned, (-quarters if mirrored else quarters) % 4, mirrored)
            found.append((np.hypot(x, y) < MIN_SINE, round(abs(turn - 90 * quarters), 6), frame))
    found.sort(key=lambda entry: entry[:2])  # stable: on a tie the unmirrored frame is first
    return [frame for *_, frame in found[:passes]]


# Channels of each map. Maps are zero outside the mask.
FEATURE_CHANNELS = {
    "photo": 3,  # unmixed, divided by its mean over the mask and all channels
    "grey_world": 3,  # unmixed, each channel divided by its own mean over the mask
    "initial_normals": 3,  # equation 2 on "photo"
    "initial_normals_grey_world": 3,  # equation 2 on "grey_world"
    "mask": 1,
    "previous": 4,  # pyramids: normals and expected error (radians) from the previous scale; zero on the first
    "lights": 9,  # the three directions (x, y, z each); one pixel, for an input of its own
    "channel_means": 3,  # of "photo" over the mask; one pixel
    "exact": 1,  # 1 if the lights and their mixing are known exactly, as in a render, else 0; one pixel
    "given": 2,  # 1 if "previous" is filled; 1 if a white photo removed the surface's colour; one pixel
}

# One value for the whole capture, of size 1 x 1: they cannot be stacked with maps.
CONSTANTS = frozenset({"lights", "channel_means", "given", "exact"})
# Lower limit of a channel's mean, as a share of the largest: an all-black channel must not divide by zero.
MIN_MEAN = 1e-4


def divide_by_means(image: F32, means: F64 | float) -> F32:
    """The image (..., 3) divided by one mean, or each channel by its own; by 1 if that is not above 0."""
    divisor: F32 = np.where(np.greater(means, 0), means, 1).astype(np.float32)
    return image / divisor


def initial_normals(image: F32, directions: F64) -> F32:
    """Equation 2: ``n = L⁻¹ c``, normalised.

    image: (..., 3) linear, one channel per light. directions: (3, 3), one unit vector per row. Returns (..., 3) unit
    vectors in the frame of the directions; black pixels get +z.
    """
    return normalised(image @ np.linalg.inv(directions).T.astype(np.float32))


def channel_count(features: Iterable[str]) -> int:
    """Number of channels of an input that stacks these features."""
    return sum(FEATURE_CHANNELS[feature] for feature in features)


class PhotoCrop(NamedTuple):
    """A window of a photo on some scale, and properties of the whole photo."""

    light: F32
    """(H, W, 3). Unmixed image."""
    mask: Bools
    """(H, W). The object."""
    directions: F64
    """(3, 3). Light directions in camera space, one light per row."""
    means: F64
    """(3,). Mean of `light` over the whole mask."""
    previous: F32 | None = None
    """(H, W, 4). The map "previous"; None on the first scale."""
    is_ground_truth: bool = False
    """Whether the lights are known exactly."""
    grey: bool = False
    """Whether a white photo removed the surface's colour."""


def feature_maps(capture: Capture, names: Iterable[str]) -> dict[str, F32]:
    """The named maps of a whole photo, each (C, H, W) float32 and zero outside the mask; constants are (C, 1, 1)."""
    light, rig, grey = capture.rig.unmixed(capture.image), capture.rig, capture.white is not None
    crop = PhotoCrop(light, capture.mask, rig.directions, mean_light(capture), None, rig.is_ground_truth, grey)
    return {name: feature_map(name, crop) for name in names}


def mean_light(capture: Capture) -> F64:
    """(3,) mean of the unmixed image over the mask."""
    total = np.zeros(3)
    for rows in bands(len(capture.mask)):
        total += np.einsum("hwc,hw->c", capture.image[rows], capture.mask[rows], dtype=np.float64)
    return np.linalg.solve(capture.rig.mixing, total / capture.mask.sum())


def feature_map(name: str, crop: PhotoCrop) -> F32:
    """The named map of a window, (C, H, W) float32 and zero outside the mask; constants are (C, 1, 1)."""
    light, mask, directions, means = crop.light, crop.mask, crop.directions, crop.means
    if name == "lights":
        return directions.astype(np.float32).reshape(9, 1, 1)
    if name == "channel_means":
        floor = np.maximum(means, MIN_MEAN * max(float(means.mean()), 1e-30))
        shares: F64 = floor / floor.mean()
        return shares.astype(np.float32).reshape(3, 1, 1)
    if name == "given":
        return np.array([crop.previous is not None, crop.grey], np.float32).reshape(2, 1, 1)
    if name == "exact":
        return np.full((1, 1, 1), crop.is_ground_truth, np.float32)
    if name in ("photo", "initial_normals"):
        values = divide_by_means(light, means.mean())
    elif name in ("grey_world", "initial_normals_grey_world"):
        values = divide_by_means(light, means)
    elif name == "mask":
        values = np.ones((*mask.shape, 1), np.float32)
    elif name == "previous":
        values = np.zeros((*mask.shape, 4), np.float32) if crop.previous is None else crop.previous
    else:
        raise KeyError(name)
    if name.startswith("initial_normals"):
        values = initial_normals(values, directions)
    return np.where(mask[..., None], values, np.float32(0)).transpose(2, 0, 1)
