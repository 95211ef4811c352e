"""What a texture holds beyond its islands."""

import numpy as np
import pytest
from synthetic import degrees_between

from mpsnet_core.bake.settings import padded

LEFT, RIGHT = np.float32([0.6, 0, 0.8]), np.float32([0, -0.6, 0.8])


def two_islands(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Two discs, each with one normal, and garbage around them."""
    row, column = np.mgrid[:height, :width]
    left = np.hypot(row - height / 2, column - width / 4) < width / 10
    right = np.hypot(row - height / 2, column - 3 * width / 4) < width / 10
    vectors = np.where(left[..., None], LEFT, np.where(right[..., None], RIGHT, np.nan)).astype(np.float32)
    return vectors, left | right


@pytest.mark.parametrize("shape", [(64, 64), (61, 83), (1, 40), (300, 300)])
def test_push_pull_leaves_islands_alone_and_no_hole(shape: tuple[int, int]) -> None:
    vectors, covered = two_islands(*shape)
    filled = padded(vectors, covered, "push-pull", 0)
    assert np.array_equal(filled[covered], vectors[covered])
    assert np.linalg.norm(filled, axis=-1) == pytest.approx(1, abs=1e-5)
    # All is between the two: their weights as they would have to be are no less than 0, and make the vector up.
    weights = np.linalg.lstsq(np.stack([LEFT, RIGHT], axis=1), filled.reshape(-1, 3).T, rcond=None)
    assert weights[0].min() > -1e-4 and weights[1].max() < 1e-6


def test_push_pull_is_smooth_and_nearest_is_not() -> None:
    vectors, covered = two_islands(256, 256)
    between = degrees_between(LEFT, RIGHT)
    steps = {}
    for padding, margin in (("push-pull", 0), ("nearest", 256)):
        filled = padded(vectors, covered, padding, margin)
        assert np.isfinite(filled).all()
        down, right = degrees_between(filled[1:], filled[:-1]), degrees_between(filled[:, 1:], filled[:, :-1])
        steps[padding] = max(down.max(), right.max())
        beside = filled[128, [128 - 64 + 27, 128 + 64 - 27]]  # just off the discs' edges
        assert degrees_between(beside, [LEFT, RIGHT]).max() < 0.15 * between
    assert steps["push-pull"] < 0.15 * between < steps["nearest"]
