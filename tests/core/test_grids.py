"""Turned pixel grids against pictures that are known between their pixels, too."""

import numpy as np
import pytest
from synthetic import degrees_between

from mpsnet_core.estimate.grids import TurnedGrid, resampled

SIZE = 90, 110


def picture(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(..., 3) smooth values for places in pixels right of and above the middle."""
    waves = [np.sin(x / 6 + 0.3) * np.cos(y / 9), np.cos(x / 7 - y / 8), np.exp(-((x - 8) ** 2 + (y + 12) ** 2) / 300)]
    return np.stack(waves, axis=-1).astype(np.float32) + 1


def middle(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel's centre is above, and right of, the picture's middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return (shape[0] - 1) / 2 - rows, columns - (shape[1] - 1) / 2


def rotation(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def whole(grid: TurnedGrid) -> tuple[slice, slice]:
    return slice(0, grid.shape[0]), slice(0, grid.shape[1])


def disc() -> np.ndarray:
    y, x = middle(SIZE)
    return np.hypot(y, x / 1.2) < 40


def no_answer() -> np.ndarray:
    return np.zeros((*SIZE, 4), np.float32)


@pytest.mark.parametrize("angle", [37.0, -8.0, 45.0])
def test_the_picture_is_turned_counter_clockwise_to_a_fraction_of_a_pixel(angle: float) -> None:
    y, x = middle(SIZE)
    grid = TurnedGrid(picture(y, x), disc(), no_answer(), angle)
    values, inside = grid.read(whole(grid))
    # Where the grid lies is seen from a picture that holds its own coordinates, taken far from the edge.
    places, _ = TurnedGrid(np.stack([y, x, x], axis=-1).astype(np.float32), disc(), no_answer(), angle).read(
        whole(grid)
    )
    y_there, x_there = places[..., 0], places[..., 1]
    deep = inside & (np.hypot(y_there, x_there / 1.2) < 36)
    assert np.abs(values - picture(y_there, x_there))[deep].max() < 4e-3
    # ... and turning those coordinates gives a grid of whole pixels, x to the right and y upwards.
    turned = np.stack([x_there, y_there], axis=-1) @ rotation(angle).T
    step_right, step_down = np.diff(turned, axis=1), np.diff(turned, axis=0)
    np.testing.assert_allclose(step_right[deep[:, 1:] & deep[:, :-1]] - [1, 0], 0, atol=0.02)
    np.testing.assert_allclose(step_down[deep[1:] & deep[:-1]] - [0, -1], 0, atol=0.02)


def test_there_and_back_is_where_it_was() -> None:
    """A field of vectors, sampled by formula on the turned grid, comes back in its place and of unit length."""
    y, x = middle(SIZE)
    answer, angle = no_answer(), 31.0
    grid = TurnedGrid(np.stack([y, x, x], axis=-1).astype(np.float32), disc(), answer, angle)
    places, inside = grid.read(whole(grid))
    field = picture(places[..., 0], places[..., 1])
    field /= np.linalg.norm(field, axis=-1, keepdims=True)
    around = np.concatenate([field, np.full((*grid.shape, 1), 0.4, np.float32)], axis=-1).transpose(2, 0, 1)
    grid.write(whole(grid), whole(grid), around, inside)
    mask = disc()
    np.testing.assert_allclose(np.linalg.norm(answer[mask, :3], axis=-1), 1, atol=1e-5)
    np.testing.assert_allclose(answer[mask, 3], 0.4, atol=1e-5)
    assert not answer[~mask].any()
    deep = np.hypot(y, x / 1.2) < 36
    assert degrees_between(answer[..., :3], picture(y, x))[deep].max() < 0.3


def test_beyond_the_silhouette_nothing_bleeds_in() -> None:
    y, x = middle(SIZE)
    loud = np.where(disc()[..., None], picture(y, x), np.float32(1e6))
    for angle in (37.0, -21.0):
        grids = [TurnedGrid(image, disc(), no_answer(), angle) for image in (loud, picture(y, x))]
        (values, inside), (expected, _) = (grid.read(whole(grid)) for grid in grids)
        np.testing.assert_array_equal(values, expected)
        seen = picture(y, x)[disc()]
        assert seen.min() <= values[inside].min() and values[inside].max() <= seen.max() and not values[~inside].any()
        assert inside.sum() == pytest.approx(disc().sum(), rel=0.03)


def test_a_step_does_not_ring() -> None:
    step = np.zeros((*SIZE, 3), np.float32)
    step[:, 55:] = 1
    grid = TurnedGrid(step, np.ones(SIZE, bool), no_answer(), 20.0)
    values, inside = grid.read(whole(grid))
    assert values.min() == 0 and values.max() == pytest.approx(1, abs=1e-6) and inside.any()


@pytest.mark.parametrize("angle", [45.0, 26.0, 7.0, -33.0])
def test_every_pixel_of_a_ragged_mask_gets_a_unit_vector(angle: float) -> None:
    random = np.random.default_rng(3)
    mask = random.random(SIZE) < 0.15  # lone pixels
    mask[40, 5:100] = mask[10:80, 20] = True  # and thin lines
    answer = no_answer()
    grid = TurnedGrid(np.ones((*SIZE, 3), np.float32), mask, answer, angle)
    values, inside = grid.read(whole(grid))
    np.testing.assert_allclose(values[inside], 1, atol=1e-6)
    up = np.zeros((4, *grid.shape), np.float32)
    up[0] = inside
    up[3] = 0.5
    grid.write(whole(grid), whole(grid), up, inside)
    np.testing.assert_allclose(answer[mask, :3], np.tile([1, 0, 0], (mask.sum(), 1)), atol=1e-6)
    assert not answer[~mask].any()


def test_tiles_fill_every_pixel_once() -> None:
    random = np.random.default_rng(4)
    mask = disc() & (random.random(SIZE) < 0.9)
    answers, field = [], random.random((4, 200, 200)).astype(np.float32)
    for step in (200, 23):
        answer = no_answer()
        grid = TurnedGrid(np.ones((*SIZE, 3), np.float32), mask, answer, 37.0)
        _, inside = grid.read(whole(grid))
        for top in range(0, grid.shape[0], step):
            for left in range(0, grid.shape[1], step):
                ends = min(top + step, grid.shape[0]), min(left + step, grid.shape[1])
                place = slice(top, ends[0]), slice(left, ends[1])
                around = tuple(
                    slice(max(p.start - grid.margin, 0), min(p.stop + grid.margin, length))
                    for p, length in zip(place, grid.shape, strict=True)
                )
                _, there = grid.read(around)
                np.testing.assert_array_equal(there, inside[around])
                grid.write(place, around, field[:, *around], there)
        answers.append(answer)
    np.testing.assert_array_equal(answers[0], answers[1])
    assert (np.abs(np.linalg.norm(answers[0][mask, :3], axis=-1) - 1) < 1e-5).all()


def test_places_on_pixels_are_the_pixels() -> None:
    random = np.random.default_rng(5)
    planes, mask = random.random((2, 9, 8)).astype(np.float32), random.random((9, 8)) < 0.7
    y, x = np.mgrid[1:7, 1:6]
    values, covered = resampled(planes, mask, y.ravel().astype(float), x.ravel().astype(float))
    np.testing.assert_array_equal(covered, mask[1:7, 1:6].ravel())
    np.testing.assert_allclose(values, np.where(mask, planes, 0)[:, 1:7, 1:6].reshape(2, -1), atol=1e-6)
