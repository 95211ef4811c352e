"""Rasterising UVs and growing margins, against twins that look at every texel on its own."""

import tracemalloc

import numpy as np
import pytest
from surface_shapes import grid_triangles, texels_of

from mpsnet_core.arrays import rasterize
from mpsnet_core.arrays.rasterize import extend_to_nearest, texel_coordinates, triangle_of_texel


def owners_one_by_one(uvs: np.ndarray, size: int) -> np.ndarray:
    owner = np.full((size, size), -1)
    texels = texels_of(uvs, size)
    owner[tuple(texels.place.T)] = texels.triangle
    return owner


def owners(uvs: np.ndarray, size: int) -> np.ndarray:
    return triangle_of_texel(texel_coordinates(uvs, size), size)


def random_triangles(kind: str, count: int = 150) -> np.ndarray:
    rng = np.random.default_rng(5)
    uvs = rng.random((count, 1, 2)) + rng.normal(0, 0.2, (count, 3, 2))
    if kind == "slivers":
        uvs[:, 2] = uvs[:, 0] + rng.random((count, 1)) * (uvs[:, 1] - uvs[:, 0]) + rng.normal(0, 1e-3, (count, 2))
    elif kind == "smaller than a texel":
        uvs = rng.random((count, 1, 2)) + rng.normal(0, 0.005, (count, 3, 2))
    elif kind == "far outside":
        uvs = rng.normal(0.5, 3, (count, 3, 2))
    return uvs


@pytest.mark.parametrize("kind", ["ordinary", "slivers", "smaller than a texel", "far outside"])
@pytest.mark.parametrize("size", [1, 31, 64])
@pytest.mark.parametrize("at_once", [1 << 20, 1000, 1])
def test_each_texel_is_the_last_triangles_that_holds_its_centre(monkeypatch, kind: str, size: int, at_once: int):
    monkeypatch.setattr(rasterize, "AT_ONCE", at_once)
    uvs = random_triangles(kind)
    expected = owners_one_by_one(uvs, size)
    assert (owners(uvs, size) == expected).all()
    assert (expected >= 0).any() or size == 1


def test_memory_is_bounded_however_many_triangles_overlap() -> None:
    """As where somebody reset the UVs of a whole mesh: each polygon fills the texture."""
    count, size = 4000, 256
    uvs = np.tile([[[0.0, 0], [1, 0], [1, 1]]], (count, 1, 1))
    uvs[: count // 2] = 1 - uvs[: count // 2]
    tracemalloc.start()
    found = owners(uvs, size)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert set(np.unique(found)) == {count // 2 - 1, count - 1}
    assert peak < count * size**2  # a byte for each texel of each triangle


@pytest.mark.parametrize("turn", [0, 30, 45, 77])
@pytest.mark.parametrize("cells", [3, 7, 11])
def test_neighbours_leave_no_crack(cells: int, turn: int) -> None:
    """Triangles that share an edge cover it whole, also where it runs exactly through texel centres."""
    line = np.arange(cells + 1) / cells * 3 - 1
    x, y = np.meshgrid(line, line, indexing="ij")
    angle = np.radians(turn)
    points = np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y], -1) + 0.3
    uvs = points.reshape(-1, 2)[grid_triangles(*x.shape)]
    for size in (30, 63, 100):
        corners = texel_coordinates(uvs, size)
        middle = np.abs((np.stack(np.mgrid[:size, :size][::-1], -1) + 0.5) / size - 0.5).max(-1) < 0.4
        inside = middle if turn == 0 else np.ones_like(middle) & (_in_grid(size, angle))
        assert (triangle_of_texel(corners, size)[inside] >= 0).all()


def _in_grid(size: int, angle: float) -> np.ndarray:
    row, column = np.mgrid[:size, :size] + 0.5
    u, v = column / size - 0.3, 1 - row / size - 0.3
    x, y = np.cos(angle) * u + np.sin(angle) * v, -np.sin(angle) * u + np.cos(angle) * v
    return np.maximum(np.abs(x - 0.5), np.abs(y - 0.5)) < 1.499


@pytest.mark.parametrize("share", [0.001, 0.02, 0.4])
@pytest.mark.parametrize("distance", [0, 1, 5, 40])
def test_the_margin_holds_the_nearest_filled_texels_value(share: float, distance: int) -> None:
    rng = np.random.default_rng(11)
    size = 40
    filled = rng.random((size, size)) < share
    filled[7, 33] = True
    values = np.where(filled[..., None], rng.random((size, size, 3)), 0).astype(np.float32)
    result = extend_to_nearest(values, filled, distance)

    at = np.argwhere(filled)
    for place in np.ndindex(size, size):
        steps = np.abs(at - place).max(axis=1)
        if steps.min() > distance:
            assert (result[place] == values[place]).all()
        else:
            nearest = at[steps == steps.min()]
            assert (result[place] == values[tuple(nearest.T)]).all(axis=1).any()
