"""Noise: its statistics, its smoothness, no trace of its lattice, and cells against their own geometry."""

import numpy as np
import pytest

from mpsnet_core.synthesis.noise import fractal_noise, gradient_noise, voronoi


def points(count: int, extent: float = 40.0, seed: int = 1) -> np.ndarray:
    return (np.random.Generator(np.random.PCG64(seed)).random((count, 3)) - 0.5) * extent


def directions(count: int) -> np.ndarray:
    vectors = np.random.Generator(np.random.PCG64(2)).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


@pytest.mark.parametrize("octaves", [1, 2, 5])
def test_range_and_strength(octaves: int) -> None:
    values = fractal_noise(points(60_000), 3, octaves)
    assert values.dtype == np.float32
    assert np.abs(values).max() < 1.4
    assert abs(values.mean()) < 0.02
    assert 0.27 < values.std() < 0.34


def test_smooth_across_the_lattice() -> None:
    # Second differences along a line stay as small as a twice differentiable field's.
    line = np.linspace(0, 30, 30_001)[:, None] * directions(1)
    values = gradient_noise(line, 4).astype(np.float64)
    assert np.abs(np.diff(values)).max() < 4e-3
    assert np.abs(np.diff(values[::10], 2)).max() < 40 * 0.01**2


def test_seeds_and_places_are_unrelated() -> None:
    places = points(20_000)
    first = gradient_noise(places, 0)
    for other in (gradient_noise(places, 1), gradient_noise(places, 1 << 40), gradient_noise(places + 256, 0)):
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.05


def test_cells_are_a_unit_wide() -> None:
    cells, _, _ = voronoi(points(60_000, extent=12.0), 7)
    # 12³ cells, and those that reach in from outside.
    assert 12**3 < len(np.unique(cells)) < 14**3
    # The numbers are spread evenly, so that their remainders choose materials fairly.
    shares = np.bincount(np.unique(cells) % 3) / len(np.unique(cells))
    np.testing.assert_allclose(shares, 1 / 3, atol=0.04)


def test_borders_are_where_the_cell_changes() -> None:
    places, ways = points(60), directions(1500)
    for place, cell, neighbour, border in zip(places, *voronoi(places, 11), strict=True):
        assert border >= 0
        assert (voronoi(place + 0.98 * border * ways, 11)[0] == cell).all()
        beyond = voronoi(place + 1.1 * (border + 0.01) * ways, 11)[0]
        assert set(beyond) >= {cell, neighbour}
