"""A existing map's relief in a view is found, and taken out, where there is some; a sphere whose normals are known."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from eight_views import bumpy_normals, smoothly_wrong, unit
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh, sphere_view
from synthetic import degrees_between

from mpsnet_core import NormalMap, View, write_camera, write_image, write_normals
from mpsnet_core.arrays.resampling import bilinear
from mpsnet_core.bake.base_maps import BaseMap, read_base_map, remove_base_detail, remove_base_details
from mpsnet_core.cli import main
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.rays import RayScene

pytestmark = pytest.mark.accuracy

POSE = np.diag([1.2, 1.2, 1.2, 1.0])
POSE[:3, 3] = (4, -2, 1)
MESH = sphere_mesh(96, 48, world_from_object=POSE)
SCENE = RayScene.of(MESH)


def relief(u: np.ndarray, v: np.ndarray, height: float = 0.3) -> np.ndarray:
    """(..., 3) unit normals in tangent space at UVs: waves of a hundredth of the texture and less."""
    return unit(np.stack([height * np.sin(150 * u), height * np.cos(120 * v), np.ones_like(u)], -1))


@cache
def present(size: int = 768, shown: str = "auto") -> BaseMap:
    v, u = np.mgrid[:size, :size] + 0.5
    return BaseMap(relief(u / size, 1 - v / size).astype(np.float32), shown)


@cache
def smooth_view() -> View:
    return sphere_view(camera_looking((1, 0.2, 0.3), "perspective", size=300, target=(4, -2, 1), reach=1.3), POSE)


def worn(view: View, height: float = 0.3) -> np.ndarray:
    """(H, W, 3) the smooth view's normals with the relief: on a sphere u runs with the azimuth, v with the height."""
    normals = view.normals.vectors.astype(float) @ view.camera.rotation.T
    x, y, z = np.moveaxis(normals, -1, 0)
    u = 0.01 + 0.98 * (np.mod(np.arctan2(y, x) + np.pi / 2, 2 * np.pi) / (2 * np.pi))
    v = 0.01 + 0.98 * (np.arcsin(np.clip(z, -1, 1)) / np.pi + 0.5)
    east = unit(np.stack([-y, x, np.full_like(x, 1e-9)], -1))
    a, b, c = np.moveaxis(relief(u, v, height), -1, 0)[..., None]
    vectors = (a * east + b * np.cross(normals, east) + c * normals) @ view.camera.rotation
    return np.where(view.normals.mask[..., None], vectors, 0)


def taken_out(vectors: np.ndarray, view: View, present: BaseMap) -> tuple[np.ndarray, float]:
    normals, share = remove_base_detail(NormalMap(vectors, view.normals.mask), view.camera, MESH, SCENE, present)
    return normals.vectors, share


def inner(view: View) -> np.ndarray:
    return view.normals.vectors[..., 2] > 0.5


@pytest.mark.parametrize(("part", "shown", "most"), [(1, "auto", 1.0), (1, "yes", 1.0), (0.5, "auto", 1.5)])
def test_of_relief_that_is_shown_as_much_is_taken_out_as_was_estimated(part: float, shown: str, most: float) -> None:
    view = smooth_view()
    there, given = inner(view), worn(view, 0.3 * part)
    assert degrees_between(given, view.normals.vectors)[there].mean() > 10 * part
    vectors, share = taken_out(given, view, present(shown=shown))
    assert share == pytest.approx(part, abs=0.05)
    assert degrees_between(vectors, view.normals.vectors)[there].mean() < most


def test_the_map_repeats_where_uvs_lie_beyond_it() -> None:
    """As Blender repeats it. The mesh's UVs are those of the waves, some units of UV space further on."""
    view, on_its_tile = smooth_view(), replace(MESH, uvs=MESH.uvs + np.float32([3, -2]))
    given = NormalMap(worn(view), view.normals.mask)
    alike, beside = (
        remove_base_detail(given, view.camera, mesh, SCENE, present(shown="yes"))[0].vectors
        for mesh in (MESH, on_its_tile)
    )
    assert degrees_between(beside, alike)[inner(view)].max() < 0.1
    assert degrees_between(beside, view.normals.vectors)[inner(view)].mean() < 1.0


def test_lookups_in_a_repeated_image_are_those_in_a_tiled_one() -> None:
    """Also across the border, where the last column meets the first."""
    rng = np.random.default_rng(3)
    image = rng.uniform(size=(3, 5, 2))
    x, y = rng.uniform(-9, 14, 400), rng.uniform(-5, 8, 400)
    tiled = np.tile(image, (5, 5, 1))
    found = bilinear(image, x, y, repeat=True)
    np.testing.assert_allclose(found, bilinear(tiled, x + 10, y + 6), atol=1e-12)
    edge = np.array([-1e-9, 0.0, 5.0, np.float32(0.5) - np.float32(1e-8)], np.float32)
    assert np.isfinite(bilinear(image, edge, edge, repeat=True)).all()


def test_the_share_is_found_in_an_estimate_that_is_bent() -> None:
    view = smooth_view()
    points = view.normals.vectors @ view.camera.rotation.T
    bent = smoothly_wrong(worn(view), points, np.random.default_rng(1), 8.0)
    assert taken_out(bent, view, present())[1] == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("what", ["smooth", "other bumps", "bent"])
def test_where_the_relief_is_not_shown_the_view_stays(what: str) -> None:
    view = smooth_view()
    points = view.normals.vectors @ view.camera.rotation.T
    vectors = view.normals.vectors.astype(float)
    if what == "other bumps":
        inside = view.normals.mask
        vectors[inside] = bumpy_normals(points[inside]) @ view.camera.rotation
    elif what == "bent":
        vectors = smoothly_wrong(vectors, points, np.random.default_rng(2), 8.0)
    left, share = taken_out(vectors, view, present())
    assert share == 0
    assert np.array_equal(left, NormalMap(vectors, view.normals.mask).vectors)


def test_of_two_maps_each_has_a_share_of_its_own() -> None:
    """The upper half's relief is in the photo, that of the lower half is another; each is found on its triangles."""
    view = smooth_view()
    upper = MESH.uvs[..., 1].min(axis=1) >= 0.5 - 1e-6
    other = replace(present(), vectors=np.flip(present().vectors, (0, 1)), triangles=~upper)
    both = [replace(present(), triangles=upper), other]
    normals, shares = remove_base_details(NormalMap(worn(view), view.normals.mask), view.camera, MESH, SCENE, both)
    assert shares[0] == pytest.approx(1, abs=0.05) and shares[1] == 0
    height = (view.normals.vectors @ view.camera.rotation.T)[..., 2]
    apart = degrees_between(normals.vectors, view.normals.vectors)
    assert apart[inner(view) & (height > 0.05)].mean() < 1 and apart[inner(view) & (height < -0.05)].mean() > 10
    again, same = remove_base_details(NormalMap(worn(view), view.normals.mask), view.camera, MESH, SCENE, both, shares)
    assert same == shares and np.array_equal(again.vectors, normals.vectors)


def test_a_map_of_another_tile_is_taken_out_as_that_of_the_first() -> None:
    view = smooth_view()
    moved = replace(MESH, uvs=MESH.uvs + np.array([2, 1], np.float32))
    given = NormalMap(worn(view), view.normals.mask)
    expected, share = remove_base_detail(given, view.camera, MESH, SCENE, present())
    found, same = remove_base_detail(given, view.camera, moved, SCENE, replace(present(), corner=(2, 1)))
    assert same == pytest.approx(share, abs=1e-3)
    assert degrees_between(found.vectors, expected.vectors)[inner(view)].max() < 0.1
    assert remove_base_detail(given, view.camera, moved, SCENE, replace(present(), corner=(0, 1)))[1] == 0


def test_relief_finer_than_the_photo_is_not_taken_for_shown() -> None:
    """Single texels of a map with far more of them than the photo has pixels."""
    rng = np.random.default_rng(0)
    fine = np.concatenate([rng.normal(0, 0.5, (1536, 1536, 2)), np.ones((1536, 1536, 1))], axis=-1)
    view = smooth_view()
    vectors, _ = taken_out(view.normals.vectors, view, BaseMap(unit(fine).astype(np.float32), "yes"))
    assert degrees_between(vectors, view.normals.vectors)[inner(view)].mean() < 12  # single texels lean by 30 degrees


def test_all_frames_of_a_sequence_have_the_share_of_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fainter frame, in which alone nothing would be found, does not flicker; nor when it alone is made again."""
    monkeypatch.chdir(tmp_path)
    view = smooth_view()
    write_camera("camera.json", view.camera)
    write_mesh("mesh.npz", MESH)
    write_image("map.png", encode(present(512).vectors))
    for number, height in ((1, 0.3), (2, 0.04)):
        write_normals(f"n_{number}.png", NormalMap(worn(view, height).astype(np.float32), view.normals.mask))
    command = ["bake", "--mesh", "mesh.npz", "--size", "128", "--onto", "map.png", "--progress", "none"]
    assert main([*command, "--view", "camera.json=n_#.png", "-o", "skin"]) == 0
    assert main([*command, "--view", "camera.json=n_2.png", "-o", "alone.png"]) == 0
    frame = Path("skin/skin_0002.png")
    made = read_base_map(frame)
    lying = degrees_between(made, read_base_map("alone.png"))
    assert lying[lying > 0].mean() > 1  # where the photo sees it, and the share counts
    frame.unlink()
    assert main([*command, "--view", "camera.json=n_#.png", "-o", "skin"]) == 0
    assert np.array_equal(read_base_map(frame), made)
