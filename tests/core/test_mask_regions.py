"""Connected parts against a flood fill, and what masks are mended with against the same done pixel by pixel."""

from collections.abc import Iterator

import numpy as np
import pytest

from mpsnet_core.arrays.mask_regions import box_sums, dilated, eroded, fill_small_holes, labelled, remove_small_regions


def random_masks() -> Iterator[np.ndarray]:
    rng = np.random.default_rng(7)
    for _ in range(150):
        yield rng.random(rng.integers(1, 14, size=2)) < rng.random()
    snake = np.zeros((31, 31), bool)
    snake[::4] = snake[2::8, -1:] = True
    snake[1:31:8, -1] = snake[2:31:8, -1] = snake[3:31:8, -1] = True
    snake[5:31:8, 0] = snake[6:31:8, 0] = snake[7:31:8, 0] = True
    yield snake
    yield np.indices((16, 16)).sum(axis=0) % 2 == 0


def flooded(mask: np.ndarray, diagonal: bool) -> np.ndarray:
    """(H, W) a number for each connected part, by walking from pixel to pixel."""
    numbers = np.zeros(mask.shape, int)
    for start in map(tuple, np.argwhere(mask)):
        if numbers[start]:
            continue
        number, waiting = numbers.max() + 1, [start]
        while waiting:
            y, x = waiting.pop()
            inside = 0 <= y < mask.shape[0] and 0 <= x < mask.shape[1]
            if inside and mask[y, x] and not numbers[y, x]:
                numbers[y, x] = number
                steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if diagonal or not (dy and dx)]
                waiting += [(y + dy, x + dx) for dy, dx in steps]
    return numbers


@pytest.mark.parametrize("diagonal", [False, True])
def test_parts_are_those_of_a_flood_fill(diagonal: bool) -> None:
    for mask in random_masks():
        labels, sizes = labelled(mask, diagonal=diagonal)
        truth = flooded(mask, diagonal)
        pairs = set(zip(labels.ravel().tolist(), truth.ravel().tolist(), strict=True))
        assert len(pairs) == len(np.unique(truth)) and all((a == 0) == (b == 0) for a, b in pairs)
        assert sizes.tolist() == [int((labels == number).sum()) for number in range(truth.max() + 1)]


def test_specks_and_holes_by_their_sizes() -> None:
    for mask in random_masks():
        parts, gaps = flooded(mask, False), flooded(~mask, True)
        sizes = np.bincount(parts.ravel())
        np.testing.assert_array_equal(remove_small_regions(mask, 4), mask & (sizes[parts] >= 4))
        edge = set(np.concatenate([gaps[0], gaps[-1], gaps[:, 0], gaps[:, -1]]).tolist())
        for most in (3, np.inf):
            holes = [n for n in range(1, gaps.max() + 1) if n not in edge and (gaps == n).sum() <= most]
            np.testing.assert_array_equal(fill_small_holes(mask, most), mask | np.isin(gaps, holes))


def test_growing_and_shrinking_by_a_square() -> None:
    for mask in random_masks():
        for pixels in (1, 3):
            y, x = np.indices(mask.shape)
            near = np.zeros(mask.shape, bool)
            for row, column in np.argwhere(mask):
                near |= (abs(y - row) <= pixels) & (abs(x - column) <= pixels)
            np.testing.assert_array_equal(dilated(mask, pixels), near)
            far = np.ones(mask.shape, bool)
            for row, column in np.argwhere(~mask):
                far &= (abs(y - row) > pixels) | (abs(x - column) > pixels)
            np.testing.assert_array_equal(eroded(mask, pixels), far)


@pytest.mark.parametrize("reach", [0, 1, 3, 20])
def test_box_sums_against_windows_one_by_one(reach: int) -> None:
    values = np.random.default_rng(reach).random((9, 13))
    sums = box_sums(values, reach)
    for y, x in np.ndindex(values.shape):
        window = values[max(y - reach, 0) : y + reach + 1, max(x - reach, 0) : x + reach + 1]
        assert sums[y, x] == pytest.approx(window.sum())


def test_each_channel_grows_by_itself() -> None:
    marks = np.random.default_rng(2).random((15, 12, 3)) < 0.1
    assert np.array_equal(dilated(marks, 1), np.stack([dilated(marks[..., k], 1) for k in range(3)], axis=-1))
