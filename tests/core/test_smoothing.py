"""Smoothing over time, on scenes whose normals are known in every frame: noise falls, nothing lags, no edge smears."""

from collections.abc import Iterator

import numpy as np
import pytest
from synthetic import degrees_between

from mpsnet_core import InputError, NormalMap, published_rig
from mpsnet_core.estimate.sequence.run import EstimatedFrame, smoothed

SIZE = 96
NOISE = 0.01
RIG = published_rig()
X, Y = np.meshgrid((np.arange(SIZE) + 0.5) / SIZE * 2 - 1, 1 - (np.arange(SIZE) + 0.5) / SIZE * 2)


def relief(shift: float = 0.0, turn: float = 0.0) -> np.ndarray:
    """Normals of shallow waves, moved to the right by `shift` or turned counter-clockwise by `turn` radians."""
    x = np.cos(turn) * X + np.sin(turn) * Y - shift
    slope = 0.35 * np.sin(9 * x)
    normals = np.stack([slope * np.cos(turn), slope * np.sin(turn), np.ones_like(slope)], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def photo(normals: np.ndarray, random: np.random.Generator, noise: float = NOISE) -> np.ndarray:
    """What equation 2 undoes, with a camera's noise: half the same everywhere, half growing with the light."""
    clean = 0.7 * np.maximum(normals @ RIG.directions.T, 0)
    strength = noise * np.sqrt(0.25 + 0.75 * clean / 0.7)
    return (clean + strength * random.standard_normal(clean.shape)).astype(np.float32)


def shot(number: int, image: np.ndarray, mask: np.ndarray | None = None) -> EstimatedFrame:
    inside = np.ones(image.shape[:2], bool) if mask is None else mask
    return EstimatedFrame(number, image, NormalMap(np.linalg.solve(RIG.directions, image[..., None])[..., 0], inside))


def scene(truth: list[np.ndarray], noise: float = NOISE) -> list[EstimatedFrame]:
    random = np.random.default_rng(5)
    return [shot(number, photo(normals, random, noise)) for number, normals in enumerate(truth)]


def error(normals: NormalMap, truth: np.ndarray) -> float:
    return float(degrees_between(normals.vectors, truth)[normals.mask].mean())


@pytest.mark.parametrize("reach", [1, 2, 4])
def test_what_stands_still_loses_noise_by_the_square_root_of_the_frames(reach: int) -> None:
    truth = [relief()] * 13
    shots = scene(truth)
    answers = dict(smoothed(shots, reach))
    assert list(answers) == list(range(13))
    inner = range(reach, 13 - reach)
    gain = np.mean([error(shots[k].normals, truth[k]) / error(answers[k], truth[k]) for k in inner])
    assert gain == pytest.approx(np.sqrt(2 * reach + 1), rel=0.08)
    # At the ends there are reach + 1 frames.
    for k in (0, 12):
        end_gain = error(shots[k].normals, truth[k]) / error(answers[k], truth[k])
        assert end_gain == pytest.approx(np.sqrt(reach + 1), rel=0.12)


def phase(normals: NormalMap) -> float:
    """Where the waves stand, in radians, from their slope's projection on a sine and a cosine over whole periods."""
    columns = slice(0, round(SIZE / 2 * 2 * 2 * np.pi / 9))  # of which there are two
    slope = normals.vectors[:, columns, 0] / normals.vectors[:, columns, 2]
    return float(np.angle((slope * np.exp(-9j * X[:, columns])).sum()))


@pytest.mark.parametrize("pixels", [0.25, 1.0, 3.0], ids=lambda pixels: f"{pixels} pixels a frame")
def test_what_moves_does_not_lag(pixels: float) -> None:
    truth = [relief(shift=number * pixels * 2 / SIZE) for number in range(11)]
    shots = scene(truth)
    answers = dict(smoothed(shots, 3))
    step = 9 * pixels * 2 / SIZE  # in radians a frame
    inner = range(3, 8)
    lags = [
        np.angle(np.exp(1j * (phase(answers[k]) - phase(NormalMap(truth[k], np.ones((SIZE, SIZE), bool))))))
        for k in inner
    ]
    assert abs(np.mean(lags)) / step < 0.02  # of a frame
    # The frame that an answer is most like is its own.
    for k in inner:
        assert min(range(11), key=lambda other: error(answers[k], truth[other])) == k
        assert error(answers[k], truth[k]) < error(shots[k].normals, truth[k])


def ball(centre: float) -> tuple[np.ndarray, np.ndarray]:
    """A sphere before a flat wall, and where it is."""
    x, y = (X - centre) / 0.4, Y / 0.4
    inside = x**2 + y**2 < 0.9
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.1))], axis=-1)
    return np.where(inside[..., None], normals, [0.0, 0.0, 1.0]), inside


def test_a_moving_edge_does_not_smear() -> None:
    scenes = [ball(-0.3 + number * 4 * 2 / SIZE) for number in range(7)]
    truth = [normals for normals, _ in scenes]
    shots = scene(truth)
    answers = dict(smoothed(shots, 3))
    for k in (2, 3, 4):
        inside = scenes[k][1]
        edge = inside ^ np.roll(inside, 2, axis=1) | inside ^ np.roll(inside, -2, axis=1)
        wall = ~(scenes[k - 2][1] | scenes[k + 2][1] | inside)
        lit = (truth[k] @ RIG.directions.T > 0).all(axis=-1)
        before, after = (degrees_between(found.vectors, truth[k]) for found in (shots[k].normals, answers[k]))
        assert after[edge & lit].mean() < 1.1 * before[edge & lit].mean()
        assert after[wall].mean() < 0.5 * before[wall].mean()


def test_confident_frames_count_more() -> None:
    image = photo(relief(), np.random.default_rng(1))
    inside = np.ones((SIZE, SIZE), bool)
    sure, unsure = relief(), np.broadcast_to([0.6, 0.0, 0.8], relief().shape)
    shots = [
        EstimatedFrame(0, image, NormalMap(sure, inside)),
        EstimatedFrame(1, image, NormalMap(unsure, inside, np.zeros(inside.shape))),
    ]
    answers = dict(smoothed(shots, 1))
    assert error(answers[1], sure) < 1 and error(answers[0], sure) < 1
    np.testing.assert_array_equal(answers[1].confidence, 0)


def test_each_frame_keeps_its_mask_and_takes_nothing_from_outside_another() -> None:
    random = np.random.default_rng(2)
    masks = [X < 0.5, X > -0.5, np.abs(Y) < 0.5]
    shots = [shot(number, photo(relief(), random), mask) for number, mask in enumerate(masks)]
    spoilt = [EstimatedFrame(s.number, np.where(s.normals.mask[..., None], s.photo, 7), s.normals) for s in shots]
    for number, normals in smoothed(spoilt, 2):
        np.testing.assert_array_equal(normals.mask, masks[number])
        assert error(normals, relief()) < error(shots[number].normals, relief())


def test_missing_numbers_are_gaps_in_time_and_unwanted_frames_only_help() -> None:
    shots = [s for s in scene([relief()] * 12) if s.number not in (4, 5, 6)]
    near = dict(smoothed(shots, 2))
    assert list(near) == [0, 1, 2, 3, 7, 8, 9, 10, 11]
    alone = dict(smoothed([s for s in shots if s.number > 6], 2))
    np.testing.assert_array_equal(near[7].vectors, alone[7].vectors)
    some = [EstimatedFrame(s.number, s.photo, s.normals, wanted=s.number in (2, 9)) for s in shots]
    wanted = dict(smoothed(some, 2))
    assert list(wanted) == [2, 9]
    for number in wanted:
        np.testing.assert_array_equal(wanted[number].vectors, near[number].vectors)


def test_numbers_may_rise_by_more_than_one() -> None:
    shots = [s for s in scene([relief()] * 9) if s.number != 4]
    apart = [EstimatedFrame(10 * s.number, s.photo, s.normals) for s in shots]
    for (number, normals), (tenfold, same) in zip(smoothed(shots, 2), smoothed(apart, 2, 10), strict=True):
        assert tenfold == 10 * number
        np.testing.assert_array_equal(same.vectors, normals.vectors)


@pytest.mark.parametrize("reach", [1, 3])
def test_no_more_shots_are_asked_for_than_an_answer_needs(reach: int) -> None:
    asked = []

    def endless() -> Iterator[EstimatedFrame]:
        image = photo(relief(), np.random.default_rng(3))
        for number in range(1000):
            asked.append(number)
            yield shot(number, image)

    for number, _ in smoothed(endless(), reach):
        assert asked[-1] <= number + reach
        if number == 10:
            break


def test_frames_of_two_sizes_are_refused() -> None:
    image = photo(relief(), np.random.default_rng(3))
    with pytest.raises(InputError, match="frames 0 and 1 are 96 x 96 and 90 x 96; smoothing needs frames of one size"):
        list(smoothed([shot(0, image), shot(1, image[:, :90])], 1))
