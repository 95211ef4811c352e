"""Curvature: balls, cylinders and planes, seen from afar and from near, whose curvature is in the books."""

import numpy as np
import pytest
from height_shapes import Surface, ball, bowl, bumps, orthographic, plane

from mpsnet_core import Camera, NormalMap, curvature, curvature_picture, curvature_range

# More rows than are worked on at a time.
NEAR = Camera("perspective", 300, 320, (420.0, 400.0), (130.0, 170.0))
FAR = orthographic(320, 300, 80)


def of(relief: Surface, **options: int) -> np.ndarray:
    return curvature(relief.normals, relief.camera, relief.depth, **options)


@pytest.mark.parametrize("radius", [0, 1, 8, 11])
@pytest.mark.parametrize(
    "surface",
    [ball(FAR, (0.1, -0.2, -5), 1.5), ball(NEAR, (0.3, -0.2, -5), 1.5), ball(NEAR, (0.4, 0.1, -2.5), 0.75)],
    ids=["from afar", "from near", "from nearer"],
)
def test_a_ball_bends_by_two_over_its_radius_at_every_slant(surface: Surface, radius: int) -> None:
    size = 1.5 if surface.depth.max() > 3 else 0.75
    found = of(surface, radius=radius)
    assert surface.mask.sum() > 20_000
    assert np.abs(found[surface.mask] * size / 2 - 1).max() < (0.03 if surface.camera is NEAR else 1e-3)
    assert np.abs(found[surface.mask] * size / 2 - 1).mean() < 2e-3
    assert (found[~surface.mask] == 0).all()


def test_a_bowl_bends_the_other_way() -> None:
    for camera in (FAR, NEAR):
        surface = bowl(camera, (0.1, -0.1, -5), 1.5)
        assert np.median(of(surface, radius=4)[surface.mask]) == pytest.approx(-2 / 1.5, rel=2e-3)


def test_a_plane_is_flat_and_a_cylinder_bends_once() -> None:
    for camera in (FAR, NEAR):
        assert np.abs(of(plane(camera, (-0.6, 0.3, 1), -4))).max() < 1e-4
    x = np.broadcast_to(np.linspace(-0.9, 0.9, 60), (40, 60))
    tube = NormalMap(np.stack([x, 0 * x, np.sqrt(1 - x**2)], axis=-1), np.ones(x.shape, bool))
    found = curvature(tube, orthographic(40, 60, 59 / 1.8 / 3), radius=4)  # a radius of 3 units
    assert found == pytest.approx(np.full(x.shape, 1 / 3), rel=1e-3)


def test_fine_grain_fades_with_the_radius_and_broad_shapes_stay() -> None:
    surface = ball(FAR, (0, 0, -5), 1.8)
    rng = np.random.default_rng(2)
    rough = NormalMap(surface.normals.vectors + rng.normal(0, 0.05, surface.normals.vectors.shape), surface.mask)
    off = [curvature(rough, FAR, radius=radius)[surface.mask] - 2 / 1.8 for radius in (0, 2, 8, 32)]
    spread = [float(np.std(values)) for values in off]
    assert spread == sorted(spread, reverse=True) and spread[-1] < 0.1 * spread[0]
    assert abs(float(off[-1].mean())) < 0.03


def test_single_pixels_and_lines_of_the_mask_do_no_harm() -> None:
    mask = np.zeros((9, 9), bool)
    mask[1, 1] = mask[4, 2:8] = True
    found = curvature(NormalMap(np.tile([0.0, 0, 1], (9, 9, 1)), mask), orthographic(9, 9), radius=3)
    assert (found == 0).all()


def test_the_picture_is_grey_where_flat_and_spans_its_range() -> None:
    surface = bumps(orthographic(64, 64))
    values = of(surface, radius=2)
    limit = curvature_range(values, surface.mask)
    assert 0.98 < (np.abs(values) <= limit).mean() < 1
    picture = curvature_picture(values, limit)
    assert picture.min() == 0 and picture.max() == 1
    inner = np.abs(values) < limit
    assert (picture[inner] - 0.5) * 2 * limit == pytest.approx(values[inner], abs=1e-5 * limit)
    assert curvature_range(np.zeros((4, 4)), np.ones((4, 4), bool)) == 1
