"""Where a weave repeats, and the line along which borders are joined."""

from itertools import product

import numpy as np
import pytest
from flat_weave import Weave

from mpsnet_core.relief.material.tiling import FEATHER, find_tiling, minimum_cut


def features(weave, noise=0.3, seed=0):
    """What a photo of the weave shows, with as much that does not repeat."""
    gradients = weave.gradients.astype(np.float32)
    random = np.random.default_rng(seed).normal(0, noise * gradients.std(), gradients.shape)
    return (gradients + random).astype(np.float32)


@pytest.mark.parametrize("degrees", [0.0, 2.0, -3.5])
@pytest.mark.parametrize("shape", [(260, 330), (300, 210)])
def test_a_tile_of_a_weave_is_a_whole_number_of_periods(degrees, shape):
    weave = Weave(shape=shape, period=23.7, degrees=degrees)
    assert all(side % weave.period > 3 for side in shape)
    found = find_tiling(features(weave), 0.2)
    for step in (found.right, found.down):
        periods = weave.axes @ step / weave.period
        assert np.abs(periods - np.round(periods)).max() < 0.02, periods
    assert min(found.correlation) > 0.8
    # Both have room in the photo with their overlap, and use most of it.
    corners = np.abs(found.right) + np.abs(found.down)
    assert (1.2 * corners <= np.array(shape[::-1]) + 1).all()
    assert found.right[0] > 0.6 * shape[1] / 1.2 and found.down[1] > 0.6 * shape[0] / 1.2


def test_what_does_not_repeat_has_a_tile_as_large_as_the_photo_allows():
    random = np.random.default_rng(1).normal(size=(240, 360, 3)).astype(np.float32)
    found = find_tiling(random, 0.2)
    assert found.correlation == (None, None)
    assert found.right.tolist() == [300, 0] and found.down.tolist() == [0, 200]
    assert found.right[1] == 0


def test_ribs_repeat_one_way_and_the_other_way_is_square_to_it():
    """Ribs that run down the picture, turned by 3°, each with a grain of its own."""
    rows, columns = np.indices((300, 300))
    across = columns * np.cos(np.radians(3)) + rows * np.sin(np.radians(3))
    ribs = np.sin(2 * np.pi * across / 19.3) + 0.4 * np.random.default_rng(2).normal(size=across.shape)
    found = find_tiling(ribs[..., None].astype(np.float32), 0.2)
    assert found.correlation[0] > 0.7
    normal = np.array([np.cos(np.radians(3)), np.sin(np.radians(3))])
    for step in (found.right, found.down):
        ribs_passed = step @ normal / 19.3
        assert abs(ribs_passed - round(ribs_passed)) < 0.03
    assert (1.2 * (np.abs(found.right) + np.abs(found.down)) <= 301).all()


def lines(height, width):
    """All lines across that move by a row at most from one column to the next."""
    for start in range(height):
        for steps in product((-1, 0, 1), repeat=width - 1):
            line = start + np.concatenate([[0], np.cumsum(steps)]).astype(int)
            if line.min() >= 0 and line.max() < height:
                yield line


@pytest.mark.parametrize("seed", range(4))
def test_the_cut_is_the_cheapest_of_all_lines(seed):
    cost = np.random.default_rng(seed).random((4 + 2 * FEATHER, 7))
    inner = cost[FEATHER:-FEATHER]
    costs = {tuple(line): inner[line, np.arange(7)].sum() for line in lines(4, 7)}
    best = min(costs, key=costs.get)
    assert tuple(minimum_cut(cost, closed=False) - FEATHER) == best
    # Closed, it is the cheapest of those that meet themselves and go through the open one's cheapest place.
    column = int(np.argmin(inner[list(best), np.arange(7)]))
    rounds = [line for line in costs if abs(line[0] - line[-1]) <= 1 and line[column] == best[column]]
    assert tuple(minimum_cut(cost, closed=True) - FEATHER) == min(rounds, key=costs.get)
