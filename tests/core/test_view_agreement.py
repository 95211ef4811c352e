"""Who sees what and who departs from whom, where both are known: planes whose views say what they are told to."""

import numpy as np
import pytest
from plane_views import SIX_SIDES, constant_view, plane
from surface_shapes import camera_looking, sphere_mesh, sphere_view

from mpsnet_core.bake.bake import bake_normals
from mpsnet_core.bake.report import view_table
from mpsnet_core.bake.view_agreement import agreement, table_rows
from mpsnet_core.scene.rays import RayScene

AHEAD = camera_looking((0, 0, 1))


def tilted(degrees: float) -> list[float]:
    return [float(np.sin(np.radians(degrees))), 0.0, float(np.cos(np.radians(degrees)))]


def test_the_texture_says_how_many_views_saw_it_and_how_far_apart_they_are() -> None:
    """Two views 10 degrees apart are each 5 from their mean, and so is the angle of the mean cosine."""
    views = [constant_view(AHEAD, tilted(10)), constant_view(AHEAD, tilted(0))]
    texture = bake_normals(plane(), views, size=32, margin=0)
    assert (texture.views == 2).all()
    assert texture.spread == pytest.approx(5, abs=0.05)
    three = bake_normals(plane(), [*views, constant_view(AHEAD, tilted(5))], size=32, margin=0)
    cosines = np.cos(np.radians([5, 5, 0]))
    assert (three.views == 3).all() and three.spread == pytest.approx(np.degrees(np.arccos(cosines.mean())), abs=0.05)
    alone = bake_normals(plane(), views[:1], size=32, margin=0)
    assert (alone.views == 1).all() and (alone.spread == 0).all()


def test_views_that_agree_are_not_apart() -> None:
    mesh = sphere_mesh(48, 24)
    views = [sphere_view(camera_looking(side)) for side in SIX_SIDES]
    texture = bake_normals(mesh, views, size=128, margin=0)
    assert np.array_equal(texture.views > 0, texture.seen) and texture.views.max() >= 3
    assert texture.spread.max() < 1.5 and texture.spread[texture.views > 1].mean() < 0.1  # the facets, at a glance


def test_each_view_is_reported_its_share_and_how_far_it_departs_from_the_others() -> None:
    mesh = plane()
    said = agreement(mesh, RayScene.of(mesh), count=4000)
    mask = np.zeros((256, 256), bool)
    mask[:, :128] = True
    whole = constant_view(AHEAD, tilted(0))
    half = constant_view(AHEAD, tilted(12))
    half = type(half)(AHEAD, type(half.normals)(half.normals.vectors, mask))
    mended = constant_view(AHEAD, tilted(1))
    mended = type(half)(AHEAD, type(half.normals)(mended.normals.vectors, mask))
    said.add("whole", whole, whole, 0.0)
    said.add("half", half, mended, 11.0)
    one, other = said.views()
    assert (one.seen, other.seen) == (pytest.approx(1), pytest.approx(0.5, abs=0.01))
    assert (one.before, one.after) == (pytest.approx(12, abs=0.01), pytest.approx(1, abs=0.01))
    assert (other.before, other.after) == (pytest.approx(12, abs=0.01), pytest.approx(1, abs=0.01))
    assert (one.level, other.level) == (0.0, 11.0)
    assert table_rows([other])[0]["after_deg"] == pytest.approx(1, abs=0.01)


def test_a_view_that_nobody_shares_departs_from_nobody() -> None:
    mesh = sphere_mesh()
    said = agreement(mesh, RayScene.of(mesh), count=2000)
    for side in ((1, 0, 0), (-1, 0, 0)):
        view = sphere_view(camera_looking(side))
        said.add(str(side[0]), view, view, 0.0)
    for view in said.views():
        assert np.isnan(view.before) and 0.35 < view.seen < 0.5
    assert table_rows(said.views())[0]["before_deg"] is None and " - " in view_table(said.views())
