"""The canonical light frame: one light nearly straight up in the picture, the others counter-clockwise from it."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)

QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
MIRROR = np.diag([-1.0, 1.0, 1.0])
# A light that stands nearer to the viewing axis than this (3 degrees, as the sine) has no tilt that could be relied on.
LEAST_SINE = 0.05


@dataclass(frozen=True)
class LightFrame:
    """The scene, picture and lights, turned by quarters about the viewing axis and mirrored, its lights reordered.

    Pixels move and none is resampled, so a remaining turn of up to 45 degrees stays, which networks learn from the
    lights' directions.

    order: which of the rig's lights are the frame's first, second and third.
    quarter_turns: counter-clockwise (x towards y), as of :func:`numpy.rot90`. mirrored: whether left and right change
    after that.
    """

    order: tuple[int, int, int] = (0, 1, 2)
    quarter_turns: int = 0
    mirrored: bool = False

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) takes column vectors from camera space into the frame; a reflection where it is mirrored."""
        turn = np.linalg.matrix_power(QUARTER_TURN, self.quarter_turns)
        return MIRROR @ turn if self.mirrored else turn

    def lights(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, 3) the rig's directions in the frame and in its order, a light a row."""
        return directions[list(self.order)] @ self.rotation.T

    def picture(self, values: NDArray[T]) -> NDArray[T]:
        """A picture (H, W, ...) as it is in the frame: a view, so that writing to it changes `values`."""
        turned = np.rot90(values, self.quarter_turns)
        return turned[:, ::-1] if self.mirrored else turned


CAMERA_FRAME = LightFrame()


def canonical_frames(directions: NDArray[np.float64], passes: int = 6) -> list[LightFrame]:
    """Frames in which the lights run counter-clockwise, the one whose first light stands most nearly straight up first.

    directions: (3, 3) a light a row, in camera space. passes: how many, 1 to 6: each light can be the first, in the
    picture and in its mirror image, which follow one another. Lights 120° apart leave at most 15° to the straight in
    the first two frames.

    The sense is that of the triangle of the lights as the camera sees it, which is defined even where a light stands
    on the viewing axis. Frames that begin with such a light come last.
    """
    found = []
    for mirrored in (False, True):
        seen = directions @ MIRROR if mirrored else directions
        order = [0, 1, 2] if np.linalg.det(seen) > 0 else [0, 2, 1]
        for first in range(3):
            turned = order[first], order[(first + 1) % 3], order[(first + 2) % 3]
            x, y = seen[turned[0], :2]
            turn = 90.0 - np.degrees(np.arctan2(y, x))
            # Halves go up wherever they are, so that a scene on its side is seen as the scene is.
            quarters = int(np.floor(round(turn / 90, 6) + 0.5))
            # The mirror comes last: what turns clockwise before it, turns counter-clockwise behind it.
            frame = LightFrame(turned, (-quarters if mirrored else quarters) % 4, mirrored)
            found.append((np.hypot(x, y) < LEAST_SINE, round(abs(turn - 90 * quarters), 6), frame))
    found.sort(key=lambda entry: entry[:2])  # stable: of two alike the one that is not mirrored
    return [frame for *_, frame in found[:passes]]
