"""Patterns against their description: where materials lie, how much there is of each, and the relief's slope."""

import numpy as np
import pytest

from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.synthesis.noise import gradient_noise, voronoi
from mpsnet_core.synthesis.scene_description import Bump, Dirt, Paint, Pattern
from mpsnet_core.synthesis.shading.pattern import bumped, dirt_weight, material_weights, paint_factors

KINDS = ("parts", "noise", "voronoi", "stripes")


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """Places in a cube with room for many features."""
    return (np.random.default_rng(1).random((20_000, 3)) * 10).astype(np.float32)


@pytest.fixture(scope="module")
def parts(points: np.ndarray) -> np.ndarray:
    return (points[:, 0] * 7).astype(np.int32)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("softness", [0.0, 0.4, 1.0])
def test_every_material_gets_its_share(points: np.ndarray, parts: np.ndarray, kind: str, softness: float) -> None:
    weights = material_weights(Pattern(kind, 2.0, softness, 0.3, (0, 0.6, 0.8), 7), 4, points, parts)
    assert weights.shape == (len(points), 4) and weights.dtype == np.float32
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-6 and weights.min() >= 0
    assert np.abs(weights.mean(axis=0) - 0.25).max() < 0.03
    mixed = (weights.max(axis=1) < 1).mean()
    if kind == "parts" or not softness:
        assert mixed == 0
    else:
        assert mixed > 0.5 * softness


def test_stripes_follow_one_another_along_their_direction(points: np.ndarray, parts: np.ndarray) -> None:
    weights = material_weights(Pattern("stripes", 2.0, direction=(0, 0.6, 0.8)), 3, points, parts)
    along = points.astype(np.float64) @ [0, 0.6, 0.8] * 2
    inside = np.abs(along - np.rint(along)) > 1e-4
    assert (weights.argmax(axis=1) == np.floor(along) % 3)[inside].all()
    soft = material_weights(Pattern("stripes", 2.0, 0.5, direction=(0, 0.6, 0.8)), 3, points, parts)
    from_border = np.abs(along - np.rint(along))
    expected = np.clip(0.5 + from_border / 0.5, 0.5, 1)
    assert np.abs(soft.max(axis=1) - expected).max() < 1e-4


def test_cells_of_one_material_blend_at_their_borders(points: np.ndarray, parts: np.ndarray) -> None:
    cell, neighbour, border = voronoi(points * 2, 9)
    weights = material_weights(Pattern("voronoi", 2.0, 0.4, seed=9), 3, points, parts)
    every = np.arange(len(points))
    apart = cell % 3 != neighbour % 3
    assert weights[every, cell % 3][apart] == pytest.approx(np.clip(0.5 + border / 0.4, 0.5, 1)[apart], abs=1e-6)
    assert (weights[every, cell % 3][~apart] == 1).all()
    hard = material_weights(Pattern("voronoi", 2.0, seed=9), 3, points, parts)
    assert (hard.argmax(axis=1) == cell % 3).all()


def test_paint_multiplies_colours_about_one(points: np.ndarray) -> None:
    assert paint_factors(Paint(), points) is None
    plain = paint_factors(Paint(1.0, 0.0, 2.0, 3), points)
    coloured = paint_factors(Paint(1.0, 1.0, 2.0, 3), points)
    assert plain is not None and coloured is not None
    for factors in (plain, coloured):
        assert factors.shape == points.shape and factors.min() > 0
        assert abs(factors.mean() - 1) < 0.03 and factors.std() > 0.2
    assert (plain[:, 0] == plain[:, 1]).all() and (plain[:, 0] == plain[:, 2]).all()
    assert np.abs(np.corrcoef(coloured.T) - np.eye(3)).max() < 0.1


@pytest.mark.parametrize("amount", [0.05, 0.3, 0.5, 1.0])
def test_dirt_covers_what_it_says(points: np.ndarray, amount: float) -> None:
    weight = dirt_weight(Dirt(amount, scale=2.0, seed=3), points)
    assert weight is not None and weight.min() >= 0 and weight.max() == 1
    assert abs(weight.mean() - amount) < 0.03
    assert dirt_weight(Dirt(0.0), points) is None


def test_bumps_turn_normals_as_a_raised_surface_would(points: np.ndarray) -> None:
    """Against a plane that the noise raises, whose normals are told by triangles on it."""
    bump = Bump(0.02, 5.0, 6)
    flat = points[:2000].astype(np.float64) * [1, 1, 0]
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), flat.shape)
    step = 1e-3

    def raised(across: float, along: float) -> np.ndarray:
        place = flat + np.array([across, along, 0])
        return place + gradient_noise(place * bump.scale, bump.seed)[:, None] * [0, 0, bump.height]

    expected = normalised(np.cross(raised(step, 0) - raised(-step, 0), raised(0, step) - raised(0, -step)))
    found = bumped(bump, flat.astype(np.float32), up)
    assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-6
    assert angular_error(up, expected).mean() > 3
    assert angular_error(found, expected).max() < 0.5
    assert (bumped(Bump(), flat, up) == up).all()
