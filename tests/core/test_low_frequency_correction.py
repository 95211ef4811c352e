"""Levelling: a tilted or bent view is put right, its detail stays, and what is right already is left alone."""

import numpy as np
import pytest
from eight_views import bumpy_normals, smoothly_wrong, turn
from surface_shapes import camera_looking, sphere_mesh, sphere_view
from synthetic import degrees_between

from mpsnet_core import Camera, Mesh, NormalMap, View
from mpsnet_core.bake.low_frequency_correction import correct_low_frequencies, find_low_frequency_correction

MESH = sphere_mesh(96, 48)


def smooth_view(projection: str = "perspective", size: int = 360) -> View:
    return sphere_view(camera_looking((1, 0.3, 0.4), projection, size=size))


def in_front(view: View) -> np.ndarray:
    """Pixels in which the sphere is not seen at a glance: there the mesh of triangles is not the sphere."""
    return view.normals.vectors[..., 2] > 0.35


def after(vectors: np.ndarray, view: View, mesh: Mesh = MESH, scale: float = 0.03) -> np.ndarray:
    return correct_low_frequencies(NormalMap(vectors, view.normals.mask), view.camera, mesh, scale=scale).vectors


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_an_estimate_that_is_the_meshs_own_stays(projection: str) -> None:
    view = smooth_view(projection)
    change = degrees_between(after(view.normals.vectors, view), view.normals.vectors)
    assert change[in_front(view)].max() < 0.35  # the sphere stands before the mesh's flat triangles


@pytest.mark.parametrize("axis", [(1, 0, 0), (0.5, -1, 0), (0, 0, 1)], ids=["nods", "leans", "rolls"])
def test_a_tilted_view_is_put_right(axis: tuple[float, float, float]) -> None:
    """Rolls, too: about a surface's own normal the smooth normals tell no roll, but their change around it does."""
    view = smooth_view()
    tilted = view.normals.vectors @ turn(np.array(axis), 12).T
    before = degrees_between(tilted, view.normals.vectors)[in_front(view)]
    error = degrees_between(after(tilted, view), view.normals.vectors)[in_front(view)]
    assert before.mean() > 5 and error.mean() < 0.25


def test_it_does_not_matter_how_the_mesh_is_placed_and_stretched() -> None:
    pose = np.eye(4)
    pose[:3, :3] = turn(np.array([1.0, 2, 3]), 50) @ np.diag([1.3, 0.8, -1.0])
    pose[:3, 3] = (40.0, -7.0, 2.0)
    camera = camera_looking((0.4, 1, 0.3), "perspective", size=300, target=tuple(pose[:3, 3]), reach=1.5)
    view = sphere_view(camera, pose)
    tilted = view.normals.vectors @ turn(np.array([1.0, 1, 0]), 10).T
    mesh = sphere_mesh(96, 48, world_from_object=pose)
    error = degrees_between(after(tilted, view, mesh), view.normals.vectors)[in_front(view)]
    assert error.mean() < 0.5


def test_small_relief_stays_and_what_is_smoothly_wrong_goes() -> None:
    """Relief of a wavelength of 0.06 of the mesh's size, at a scale of 0.06."""
    view = smooth_view(size=480)
    positions = view.normals.vectors @ view.camera.rotation.T
    inside, front = view.normals.mask, in_front(view)
    truth = np.broadcast_to([0.0, 0, 1], positions.shape).copy()
    truth[inside] = bumpy_normals(positions[inside]) @ view.camera.rotation
    wrong = smoothly_wrong(truth, positions, np.random.default_rng(3), 8.0)
    detail = degrees_between(truth, view.normals.vectors)[front]
    kept = degrees_between(after(truth, view, scale=0.06), truth)[front]
    mended = degrees_between(after(wrong, view, scale=0.06), truth)[front]
    print(f"detail {detail.mean():.2f}, lost of it {kept.mean():.2f}")
    print(f"wrong by {degrees_between(wrong, truth)[front].mean():.2f}, levelled {mended.mean():.2f} degrees")
    assert detail.mean() > 12 and kept.mean() < 0.06 * detail.mean()
    assert degrees_between(wrong, truth)[front].mean() > 5 and mended.mean() < 1.8


def two_plates() -> tuple[Mesh, Camera]:
    """A plate that faces +z and, before its right half seen from +z, another that leans by 30 degrees."""
    plate = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    lean = turn(np.array([0.0, 1, 0]), 30)
    front = (plate * (0.5, 0.9, 1)) @ lean.T + (0.5, 0, 1.2)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    normals = np.repeat(np.array([[0, 0, 1.0], lean[:, 2]]), 2, axis=0)[:, None].repeat(3, axis=1)
    mesh = Mesh(np.concatenate([plate, front]), triangles, normals, np.random.default_rng(0).random((4, 3, 2)))
    return mesh, camera_looking((0, 0, 1), size=200, reach=1.2)


def test_nothing_reaches_over_from_what_stands_behind() -> None:
    """Each plate is wrong in its own way; right beside the edge between them each is put right by its own."""
    mesh, camera = two_plates()
    row, column = np.mgrid[:200, :200]
    x, y = (column - 99.5) * 0.012, (99.5 - row) * 0.012
    at_front = (np.abs(x - 0.5) < 0.5 * np.cos(np.radians(30))) & (np.abs(y) < 0.9)
    mask = at_front | ((np.abs(x) < 1) & (np.abs(y) < 1))
    own = np.where(at_front[..., None], turn(np.array([0.0, 1, 0]), 30)[:, 2], [0, 0, 1.0])
    lean, nod = turn(np.array([0.0, 1, 0]), 10), turn(np.array([1.0, 0, 0]), -10)
    wrong = np.where(at_front[..., None], own @ lean.T, own @ nod.T)
    result = correct_low_frequencies(NormalMap(wrong, mask), camera, mesh, scale=0.05).vectors
    edge = np.zeros_like(mask)
    edge[:, 1:] |= at_front[:, 1:] != at_front[:, :-1]
    edge[:, :-1] |= edge[:, 1:]
    assert degrees_between(result, own)[mask & ~edge].max() < 0.5


def test_where_the_mesh_is_not_seen_the_nearest_turn_holds() -> None:
    """A mask may reach beyond the mesh: no step at the mesh's border. And a view of nothing stays as it is."""
    view = smooth_view(size=200)
    tilt = turn(np.array([1.0, 0, 0]), 10)
    everywhere = np.where(view.normals.mask[..., None], view.normals.vectors, [0, 0, 1]) @ tilt.T
    result = correct_low_frequencies(NormalMap(everywhere, np.ones((200, 200), bool)), view.camera, MESH).vectors
    beyond = ~view.normals.mask
    assert 5 < degrees_between(result, everywhere)[beyond].mean() < 15
    away = camera_looking((1, 0, 0), size=64, target=(0, 50, 0))
    untouched = NormalMap(np.broadcast_to([0.6, 0, 0.8], (64, 64, 3)), np.ones((64, 64), bool))
    assert np.array_equal(correct_low_frequencies(untouched, away, MESH).vectors, untouched.vectors)
    assert find_low_frequency_correction(untouched, away, MESH, None, 0.1, False).mean_angle == 0


@pytest.mark.long
def test_a_large_view_is_levelled_as_a_small_one() -> None:
    """The mesh is traced at fewer pixels than a large photo has; what it says is the same."""
    small, large = smooth_view(size=500), smooth_view(size=1500)
    tilt = turn(np.array([1.0, 1, 0]), 9)
    thinned = after(large.normals.vectors @ tilt.T, large)[1::3, 1::3]
    change = degrees_between(thinned, after(small.normals.vectors @ tilt.T, small))
    assert change[in_front(small)].max() < 0.2


@pytest.mark.parametrize("expected", [0.0, 1.0, 8.0], ids=lambda degrees: f"{degrees:g} degrees")
@pytest.mark.parametrize("lacks", [0.0, 25.0], ids=["the shape", "a wrong shape"])
def test_what_agrees_is_taken_as_far_as_the_estimate_doubts_itself(expected: float, lacks: float) -> None:
    """An estimate that errs by 6 degrees is mended by the object's mesh if it says so; a mesh that lacks what the photo
    shows bends it by little; one that is sure is left alone."""
    view = smooth_view(size=240)
    front, inside = in_front(view), view.normals.mask
    lean = turn(np.array([0.4, -1, 0]), lacks)
    truth = view.normals.vectors @ lean.T  # what the photo shows, which the mesh shows turned
    tilted = truth @ turn(np.array([1.0, 0.3, 0]), -6).T
    given = NormalMap(tilted, inside, np.where(inside, np.float32(1 - expected / 90), 0))
    mended = correct_low_frequencies(given, view.camera, MESH, agreed=True)
    wholly = correct_low_frequencies(given, view.camera, MESH)
    before, after, all_of_it = (degrees_between(one.vectors, truth)[front].mean() for one in (given, mended, wholly))
    print(f"estimated {before:.2f}°, where they agree {after:.2f}°, wholly from the mesh {all_of_it:.2f}°")
    if expected == 0:
        assert np.allclose(mended.vectors, given.vectors, atol=1e-6)
    elif lacks or expected == 1:
        assert abs(after - before) < 0.3 * abs(all_of_it - before)
    else:
        assert after < 0.7 * before
