"""The canonical frame of the lights: which light comes first, which way round, and how far the scene is turned."""

import numpy as np
import pytest

from mpsnet_core.estimate.features import LightFrame, canonical_frames
from mpsnet_core.scene.rig import LightRig, direction_from_angles

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


def off_straight(frame: LightFrame, lights: np.ndarray) -> float:
    """Degrees between the frame's first light and straight up in the picture."""
    return abs(LightRig(frame.lights(lights)).tilts[0] - 90)


@pytest.mark.parametrize("tilts", TILTS)
def test_the_first_light_stands_nearly_up_and_the_others_follow_counter_clockwise(tilts: list[float]) -> None:
    given = directions(tilts)
    for frame in canonical_frames(given):
        lights = LightRig(frame.lights(given))
        assert off_straight(frame, given) <= 45
        ahead = (lights.tilts - lights.tilts[0]) % 360
        assert 0 < ahead[1] < ahead[2]
        # It is the same scene: each light keeps its slant, and the angles between lights are what they were.
        order = list(frame.order)
        assert lights.slants == pytest.approx(np.array([25, 35, 45])[order])
        np.testing.assert_allclose(lights.directions @ lights.directions.T, given[order] @ given[order].T, atol=1e-12)


@pytest.mark.parametrize("tilts", TILTS)
def test_each_light_has_its_turn_in_the_picture_and_in_its_mirror_image_the_straightest_first(tilts: list) -> None:
    frames = canonical_frames(directions(tilts))
    assert sorted((frame.order[0], frame.mirrored) for frame in frames) == [
        (light, mirrored) for light in range(3) for mirrored in (False, True)
    ]
    off = [off_straight(frame, directions(tilts)) for frame in frames]
    assert (np.diff(off) > -1e-6).all()
    for passes in range(1, 7):
        assert canonical_frames(directions(tilts), passes) == frames[:passes]


@pytest.mark.parametrize(("tilt", "quarters"), [(0, 1), (180, 3), (270, 2), (0.4, 1), (359.6, 1), (90.4, 0)])
def test_the_scene_is_turned_by_quarters(tilt: float, quarters: int) -> None:
    (frame,) = canonical_frames(directions([tilt, tilt + 100, tilt + 220]), 1)
    assert (frame.order[0], frame.quarter_turns) == (0, quarters)
    assert set(np.abs(frame.rotation).ravel()) == {0.0, 1.0}


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("quarters", range(4))
def test_turning_a_vector_is_turning_the_picture(quarters: int, mirrored: bool) -> None:
    """A bright pixel stands where the vector to it points, before and after."""
    frame = LightFrame(quarter_turns=quarters, mirrored=mirrored)
    picture = np.zeros((5, 5))
    picture[1, 4] = 1  # two to the right, one up
    (row,), (column,) = np.nonzero(frame.picture(picture))
    np.testing.assert_array_equal(frame.rotation @ [2, 1, 0], [column - 2, 2 - row, 0])


@pytest.mark.parametrize("tilts", [*TILTS, [45, 135, 315], [45, 225, 330]])
def test_a_scene_on_its_side_is_seen_as_the_scene_is(tilts: list[float]) -> None:
    """Also where lights stand half-way between two quarters, and by an unknown hair to either side of it."""
    given = directions(tilts)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for count, nudge in ((1, 0), (2, 1e-9), (3, -1e-9)):
        turned = given @ np.linalg.matrix_power(quarter, count).T
        for frame, other in zip(canonical_frames(given), canonical_frames(turned + nudge), strict=True):
            np.testing.assert_allclose(other.lights(turned), frame.lights(given), atol=1e-7)


def test_a_light_on_the_viewing_axis_does_not_upset_the_sense_and_comes_first_last() -> None:
    lights = LightRig(np.array([[0.4, 0.1, 1], [0, 0, 1], [0.1, 0.5, 1]])).directions
    frames = canonical_frames(lights)
    assert [frame.order[0] for frame in frames[4:]] == [1, 1]
    for x, y in ((1e-9, 1e-9), (-1e-9, 0), (0.03, -0.02)):
        nudge = np.array([[0, 0, 0], [x, y, 0], [0, 0, 0]])
        assert canonical_frames(lights + nudge, 4) == frames[:4]
    assert [frame.order for frame in frames[:4] if not frame.mirrored] == [(2, 1, 0), (0, 2, 1)]
