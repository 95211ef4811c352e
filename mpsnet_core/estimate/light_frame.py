"""The canonical light frame: one light straight up in the picture, the others counter-clockwise from it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Quarter turns move pixels and lose nothing; what is left of a turn is not worth resampling below this, in degrees.
LEAST_TURN = 0.5

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class LightFrame:
    """The scene, picture and lights, turned about the viewing axis, and its lights in another order.

    order: which of the rig's lights are the frame's first, second and third.
    quarter_turns: whole quarter turns, counter-clockwise (x towards y), as of :func:`numpy.rot90`.
    rest: the degrees turned after that, counter-clockwise, -45 to 45; at 0 no pixel is resampled.
    """

    order: tuple[int, int, int] = (0, 1, 2)
    quarter_turns: int = 0
    rest: float = 0.0

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) takes column vectors from camera space into the frame."""
        sine, cosine = np.sin(np.radians(self.rest)), np.cos(np.radians(self.rest))
        rest = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        # The whole turns come first and are exact, so that a scene turned by 90° gives the same numbers here.
        return rest @ np.linalg.matrix_power(QUARTER_TURN, self.quarter_turns)

    def lights(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, 3) the rig's directions in the frame and in its order, a light a row."""
        return directions[list(self.order)] @ self.rotation.T


CAMERA_FRAME = LightFrame()


def canonical_frames(directions: NDArray[np.float64], passes: int = 1) -> list[LightFrame]:
    """Frames in which the first light has tilt 90° and the three run counter-clockwise, as seen from the camera.

    directions: (3, 3) a light a row, in camera space. passes: 1, where the first light is the rig's, or 3, where each
    of the three has its turn at being the first.

    The sense is that of the triangle of the lights as the camera sees it, which is told even where a light stands on
    the viewing axis. A first light that stands exactly there has no tilt, and 0 is taken.
    """
    order = [0, 1, 2] if np.linalg.det(directions) > 0 else [0, 2, 1]
    frames = []
    for first in range(passes):
        turned: tuple[int, int, int] = (order[first], order[(first + 1) % 3], order[(first + 2) % 3])
        x, y = directions[turned[0], :2]
        turn = 90.0 - np.degrees(np.arctan2(y, x))
        quarters = round(turn / 90)
        rest = turn - 90 * quarters
        frames.append(LightFrame(turned, quarters % 4, float(rest) if abs(rest) >= LEAST_TURN else 0.0))
    return frames
