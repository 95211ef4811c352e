"""The canonical light frame: the first light nearly straight up in the image, the others counter-clockwise from it."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

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
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) matrix from camera space into the frame, for column vectors; a reflection if mirrored."""
        turn = np.linalg.matrix_power(QUARTER_TURN, self.quarter_turns)
        return MIRROR @ turn if self.mirrored else turn

    def lights(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, 3) the rig's directions in the frame and in its order, one light per row."""
        return directions[list(self.order)] @ self.rotation.T

    def picture(self, values: NDArray[T]) -> NDArray[T]:
        """An image (H, W, ...) in the frame. It is a view: writing to it changes `values`."""
        turned = np.rot90(values, self.quarter_turns)
        return turned[:, ::-1] if self.mirrored else turned


CAMERA_FRAME = LightFrame()


def canonical_frames(directions: NDArray[np.float64], passes: int = 6) -> list[LightFrame]:
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
