"""Feathering: the distance to a view's borders against a search through all pixels, and bakes without a step."""

import numpy as np
import pytest
from plane_views import constant_view, plane, plate_before_plane
from surface_shapes import camera_looking
from synthetic import degrees_between

from mpsnet_core import NormalMap, View, bake_normals
from mpsnet_core.bake.projection import border_distance


@pytest.mark.parametrize("limit", [1, 4, 40])
def test_the_distance_is_that_to_the_nearest_pixel_outside(limit: int) -> None:
    rng = np.random.default_rng(limit)
    for share in (0.0, 0.02, 0.3, 1.0):
        inside = rng.random((19, 31)) >= share
        outside = np.argwhere(~np.pad(inside, 1)) - 1  # all around is outside, too
        places = np.argwhere(np.ones_like(inside))
        nearest = np.sqrt(((places[:, None] - outside) ** 2).sum(-1).min(axis=1)).reshape(inside.shape)
        assert border_distance(inside, limit) == pytest.approx(np.minimum(nearest, limit), abs=1e-5)


def halves() -> list[View]:
    """Two views from ahead that say other things; the first one's mask ends in the square's middle."""
    camera = camera_looking((0, 0, 1), size=256, reach=1.1)
    second = constant_view(camera, [0.3, 0.0, 0.95])
    first = constant_view(camera, [-0.3, 0.0, 0.95])
    mask = np.zeros((256, 256), bool)
    mask[:, :128] = True
    return [View(camera, NormalMap(first.normals.vectors, mask)), second]


def steps(vectors: np.ndarray) -> np.ndarray:
    return degrees_between(vectors[:, 1:], vectors[:, :-1])


def test_a_view_that_ends_leaves_no_step() -> None:
    sharp = bake_normals(plane(), halves(), size=128, space="object", margin=0)
    soft = bake_normals(plane(), halves(), size=128, space="object", margin=0, feather=0.1)
    middle = slice(40, 88)
    assert steps(sharp.vectors)[middle].max() > 10
    assert steps(soft.vectors)[middle, 8:-8].max() < 3
    assert (soft.seen == sharp.seen).all() and np.array_equal(soft.views, sharp.views)


def test_beside_an_edge_the_camera_that_is_slightly_wrong_bakes_the_other_view() -> None:
    """A small plate floats before a large one. The wrong view shows the plate's normals beside it, on the large one."""
    mesh = plate_before_plane()
    ahead = camera_looking((0, 0, 1), size=400, reach=1.2)
    x = (np.arange(400) - 199.5) * 0.006
    on_plate = (np.abs(x - 0.03) < 0.3)[None, :] & (np.abs(x) < 0.3)[:, None]  # five pixels off
    wrong = np.where(on_plate[..., None], [0.6, 0, 0.8], [0, 0, 1.0])
    aside = camera_looking((-1, 0, 2), size=400, reach=1.4)
    views = [View(ahead, NormalMap(wrong, np.ones((400, 400), bool))), constant_view(aside, [0, 0, 1.0])]
    texels = np.s_[110:190, 66:69]  # the large plate just right of the small one, which the view from aside sees not
    beside = np.s_[120:180, 132 // 2 : 136 // 2]
    errors = []
    for feather in (0.0, 0.05):
        texture = bake_normals(mesh, views, size=200, space="object", margin=0, feather=feather)
        assert texture.seen[texels].any()
        errors.append(degrees_between(texture.vectors, [0, 0, 1.0])[beside].mean())
    assert errors[1] < 0.6 * errors[0]
