"""The canonical frame of the lights: which light comes first, which way round, and how far the scene is turned."""

import numpy as np
import pytest
from synthetic import degrees_between

from mpsnet_core.estimate.light_frame import LEAST_TURN, canonical_frames
from mpsnet_core.rig import LightRig, direction_from_angles, published_rig

TILTS = [
    [90, 210, 330],
    [90, 330, 210],
    [17, 170, 250],
    [250, 17, 170],
    [17, 250, 170],
    [-100, 30, 140],
    [44, 300, 181],
]


def directions(tilts) -> np.ndarray:
    return LightRig(direction_from_angles([25, 35, 45], tilts)).directions


@pytest.mark.parametrize("tilts", TILTS)
def test_the_first_light_stands_up_and_the_others_follow_counter_clockwise(tilts: list[float]) -> None:
    for first, frame in enumerate(canonical_frames(directions(tilts), 3)):
        lights = LightRig(frame.lights(directions(tilts)))
        assert lights.tilts[0] == pytest.approx(90, abs=LEAST_TURN)
        ahead = (lights.tilts - lights.tilts[0]) % 360
        assert 0 < ahead[1] < ahead[2]
        # It is the same scene: each light keeps its slant, and the angles between lights are what they were.
        order = list(frame.order)
        assert lights.slants == pytest.approx(np.array([25, 35, 45])[order])
        given = directions(tilts)[order]
        np.testing.assert_allclose(lights.directions @ lights.directions.T, given @ given.T, atol=1e-12)
        if first == 0:
            assert order[0] == 0


@pytest.mark.parametrize("tilts", TILTS)
def test_three_passes_give_each_light_its_turn_in_the_same_sense(tilts: list[float]) -> None:
    one, two, three = (frame.order for frame in canonical_frames(directions(tilts), 3))
    assert one[1:] + one[:1] == two and two[1:] + two[:1] == three
    assert canonical_frames(directions(tilts)) == canonical_frames(directions(tilts), 3)[:1]


def test_the_published_rig_is_left_as_it_is() -> None:
    (frame,) = canonical_frames(published_rig().directions)
    assert (frame.order, frame.quarter_turns, frame.rest) == ((0, 1, 2), 0, 0.0)


@pytest.mark.parametrize(("tilt", "quarters"), [(0, 1), (180, 3), (270, 2), (0.4, 1), (359.6, 1), (90.4, 0)])
def test_nothing_is_resampled_where_quarter_turns_do(tilt: float, quarters: int) -> None:
    (frame,) = canonical_frames(directions([tilt, tilt + 100, tilt + 250]))
    assert (frame.quarter_turns, frame.rest) == (quarters, 0.0)
    assert set(np.abs(frame.rotation).ravel()) == {0.0, 1.0}


def test_turning_a_vector_is_turning_the_picture() -> None:
    """A bright pixel stands where the vector to it points, before and after numpy's own quarter turn."""
    (frame,) = canonical_frames(directions([0, 100, 250]))
    picture = np.zeros((5, 5))
    picture[1, 4] = 1  # two to the right, one up
    (row,), (column,) = np.nonzero(np.rot90(picture, frame.quarter_turns))
    np.testing.assert_array_equal(frame.rotation @ [2, 1, 0], [column - 2, 2 - row, 0])


def test_a_light_on_the_viewing_axis_does_not_upset_the_sense() -> None:
    lights = LightRig(np.array([[0.4, 0.1, 1], [0, 0, 1], [0.1, 0.5, 1]])).directions
    turn = np.radians(37)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    for nudge in (1e-9, -1e-9):
        (frame,), (turned,) = canonical_frames(lights), canonical_frames(lights @ rotation.T + [nudge, nudge, 0])
        assert frame.order == turned.order
        assert degrees_between(turned.lights(lights @ rotation.T), frame.lights(lights)).max() < 1e-3
