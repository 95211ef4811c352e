"""Several textures and several meshes in one bake, and several points a texel, where the answer is known."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from surface_shapes import camera_looking, first_on_sphere, sphere_mesh, sphere_view, texels_of, towards_camera
from synthetic import degrees_between
from uv_squares import squares

from mpsnet_core import BakeSettings, Camera, InputError, Mesh, NormalMap, Texture
from mpsnet_core.bake.bake import View, bake_normals, bake_texture_sets
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.texture_sets import texture_sets

SIZE = 64
SIDES = [(1, 0.1, 0), (-1, 0, 0.1), (0, 1, 0.1), (0.1, -1, 0), (0.1, 0, 1), (0, 0.1, -1)]


def baked(
    meshes: list[Mesh], views: list[View], *, by: tuple[str, ...] = (), progress: Progress = silent, **settings: Any
) -> list[Texture]:
    baking = BakeSettings(**{"size": SIZE, "margin": 0, **settings})
    chosen = texture_sets(meshes, **dict.fromkeys(by, True))
    return [texture for _, texture in bake_texture_sets(meshes, views, chosen, baking, progress=progress)]


def same(one: Texture, other: Texture) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("seen", "covered", "views")
    ) and np.allclose(one.vectors, other.vectors, atol=1e-5)


@pytest.mark.parametrize("space", ["tangent", "object"])
@pytest.mark.parametrize("samples", [1, 2])
def test_tiles_are_the_single_bakes_of_shifted_uvs(space: str, samples: int) -> None:
    whole = sphere_mesh()
    mesh, views = replace(whole, uvs=2 * whole.uvs), [sphere_view(camera_looking(side)) for side in SIDES[:3]]
    settings = {"space": space, "samples": samples, "margin": 3}
    tiles = baked([mesh], views, by=("tiles",), **settings)
    assert len(tiles) == 4
    for tile, (right, up) in zip(tiles, [(0, 0), (1, 0), (0, 1), (1, 1)], strict=True):
        shifted = replace(mesh, uvs=mesh.uvs - np.float32([right, up]), given_tangents=mesh.tangents)
        assert tile.covered.mean() > 0.8 and same(tile, bake_normals(shifted, views, size=SIZE, **settings))
    # Put together they are the one texture of twice the size.
    together = np.block([[[tiles[2].seen, tiles[3].seen]], [[tiles[0].seen, tiles[1].seen]]]).reshape(2 * SIZE, -1)
    assert (together == bake_normals(whole, views, size=2 * SIZE, **settings).seen).mean() > 0.999


def pose(scale: tuple[float, float, float], place: tuple[float, float, float], turn: float) -> np.ndarray:
    matrix = np.eye(4)
    a = np.radians(turn)
    matrix[:3, :3] = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ np.diag(scale)
    matrix[:3, 3] = place
    return matrix


POSES = [pose((0.8, 0.8, 0.8), (-1.2, 0, 0), 40), pose((-0.5, 0.8, 0.7), (1.2, 0.4, 0.2), -25)]


@cache
def view_of_both(side: tuple[float, float, float]) -> View:
    """What a camera sees of the two spheres at `POSES`: of each pixel the nearer one's normal."""
    camera = camera_looking(side, size=384, reach=2.6)
    views = [sphere_view(camera, each) for each in POSES]
    row, column = np.mgrid[:384, :384].reshape(2, -1) + 0.5
    focal = camera.focal[0]
    on_image = np.stack([(column - 192) / focal, (192 - row) / focal, np.zeros(len(row))], axis=1)
    origins = on_image @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]
    towards = towards_camera(camera, origins)
    depths = []
    for each in POSES:
        point = first_on_sphere(origins, towards, each) @ each[:3, :3].T + each[:3, 3]
        depths.append(np.nan_to_num((point * towards).sum(axis=1), nan=-np.inf).reshape(384, 384))
    first = depths[0] >= depths[1]
    vectors = np.where(first[..., None], views[0].normals.vectors, views[1].normals.vectors)
    return View(camera, NormalMap(vectors, views[0].normals.mask | views[1].normals.mask))


@pytest.mark.parametrize("space", ["tangent", "object"])
def test_objects_in_one_go_have_each_their_own_normals(space: str) -> None:
    """Two spheres, one of them mirrored and stretched, in textures of their own and in one that they share."""
    views = [view_of_both(side) for side in SIDES]
    meshes = [sphere_mesh(48, 24, world_from_object=each) for each in POSES]
    halves = [replace(mesh, uvs=mesh.uvs * (0.5, 1) + (0.5 * n, 0)) for n, mesh in enumerate(meshes)]
    (shared,) = baked(halves, views, space=space, size=2 * SIZE)
    apart = baked(meshes, views, by=("objects",), space=space)
    assert len(apart) == 2
    for number, (mesh, half, texture) in enumerate(zip(meshes, halves, apart, strict=True)):
        for uvs, of_it, size in ((mesh.uvs, texture, SIZE), (half.uvs, shared, 2 * SIZE)):
            texels = texels_of(uvs, size)
            place = tuple(texels.place.T)
            own = texels.of(mesh.corner_normals)
            if space == "tangent":
                own = np.broadcast_to([0.0, 0.0, 1.0], own.shape)
            seen = of_it.seen[place]
            assert of_it.covered[place].all() and seen.mean() > 0.99, number
            error = degrees_between(of_it.vectors[place], own)[seen]
            assert error.mean() < 0.6 and np.percentile(error, 99) < 3, (number, size)


def grainy(camera: Camera) -> View:
    """A view whose normals are another in each pixel."""
    shape = (camera.height, camera.width)
    tilt = np.random.default_rng(3).uniform(-0.6, 0.6, (*shape, 3)) * (1, 1, 0) + (0, 0, 1)
    return View(camera, NormalMap(tilt @ camera.rotation, np.ones(shape, bool)))


@pytest.mark.parametrize("samples", [2, 4])
@pytest.mark.parametrize("size", [31, 64])
def test_several_points_a_texel_are_the_mean_of_the_finer_texture(samples: int, size: int) -> None:
    mesh, views = sphere_mesh(layout="mirrored"), [sphere_view(camera_looking(side), None) for side in SIDES[:2]]
    views.append(grainy(camera_looking((0.2, 1, 0.1), size=300)))
    texture = bake_normals(mesh, views, size=size, samples=samples, margin=0)
    fine = bake_normals(mesh, views, size=size * samples, margin=0)
    assert fine.views is not None and texture.views is not None
    for row in range(size):
        for column in range(size):
            block = np.s_[row * samples : (row + 1) * samples, column * samples : (column + 1) * samples]
            covered, seen = fine.covered[block], fine.seen[block]
            assert texture.covered[row, column] == covered.any()
            assert texture.seen[row, column] == seen.any()
            assert texture.views[row, column] == fine.views[block].max()
            counts = seen if seen.any() else covered  # an unseen point has no normal but the surface's own
            mean = fine.vectors[block][counts].sum(axis=0) if covered.any() else np.array([0, 0, 1])
            assert texture.vectors[row, column] == pytest.approx(mean / np.linalg.norm(mean), abs=1e-5)


def test_a_tile_that_no_view_sees_is_flat_and_nothing_seen_is_refused() -> None:
    mesh = squares((0, 0), (1, 0), side=1.0)
    camera = Camera("orthographic", 64, 64, [24, 24], world_from_camera=np.array(pose((1, 1, 1), (0.5, 0.5, 5), 0)))
    view = View(camera, NormalMap(np.broadcast_to([0.6, 0, 0.8], (64, 64, 3)), np.ones((64, 64), bool)))
    first, second = baked([mesh], [view], by=("tiles",))
    assert first.seen.all() and not second.seen.any() and (second.vectors == [0, 0, 1]).all()
    away = View(replace(camera, world_from_camera=pose((1, 1, 1), (50, 50, 5), 0)), view.normals)
    with pytest.raises(InputError, match="no view sees any of the mesh"):
        baked([mesh], [away], by=("tiles",))


def test_where_only_a_later_tile_is_seen_none_is_missing() -> None:
    """No triangle's middle is seen, so the first tile has to wait until it is known that anything is."""
    mesh = squares((0, 0), (1, 0), side=1.0)
    camera = Camera("orthographic", 16, 16, [100, 100], world_from_camera=pose((1, 1, 1), (2.1, 0.9, 5), 0))
    view = View(camera, NormalMap(np.broadcast_to([0.6, 0, 0.8], (16, 16, 3)), np.ones((16, 16), bool)))
    chosen = texture_sets([mesh], tiles=True)
    made = {
        texture_set.tile: texture
        for texture_set, texture in bake_texture_sets([mesh], [view], chosen, BakeSettings(64))
    }
    assert set(made) == {1001, 1002}
    assert not made[1001].seen.any() and 0 < made[1002].seen.sum() < 200


def test_a_material_too_small_for_a_texel_has_no_texture(caplog: pytest.LogCaptureFixture) -> None:
    mesh = squares((0, 0), (0.5, 0), materials="skin dot")
    mesh = replace(mesh, uvs=np.concatenate([mesh.uvs[:2], 1e-4 * mesh.uvs[2:]]))
    with caplog.at_level("INFO", "mpsnet_core"):
        textures = baked([mesh], [grainy(camera_looking((0, 0, 1)))], by=("materials",))
    assert len(textures) == 1
    assert any("material dot: no texel lies on its UVs" in record.getMessage() for record in caplog.records)
