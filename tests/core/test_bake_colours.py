"""Colours baked beside the normals: on spheres and plates that are painted by where they are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from bad_input import SPHERE, SQUARE, gets_one_clear_sentence
from mesh_file import write_mesh
from plane_views import SIX_SIDES, SIZE, plane
from progress_lines import events
from surface_shapes import camera_looking, sphere_mesh, sphere_view, texels_of

from mpsnet_core import BakeSettings, Camera, Mesh, read_camera, read_normals, write_albedo, write_camera
from mpsnet_core.bake.bake import View, bake_normals, bake_texture_sets
from mpsnet_core.bake.view_agreement import matched_views
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.scene.normal_map import NormalMap, write_normals
from mpsnet_core.scene.texture_sets import texture_sets


def paint(points: np.ndarray) -> np.ndarray:
    """(..., 3) the colour of points on a unit sphere: another one everywhere, smooth, between 0.1 and 0.9."""
    return 0.5 + 0.4 * points


def painted_view(side: tuple[float, float, float], brightness: float = 1.0) -> View:
    view = sphere_view(camera_looking(side, size=384))
    colours = paint(view.normals.vectors @ view.camera.rotation.T).astype(np.float32)
    return replace(view, colours=np.where(view.normals.mask[..., None], brightness * colours, np.nan))


def unit(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("samples", [1, 2])
def test_each_texel_has_the_colour_that_the_views_show_there(samples: int) -> None:
    mesh = sphere_mesh(48, 24)
    texture = bake_normals(mesh, [painted_view(side) for side in SIX_SIDES], size=SIZE, samples=samples)
    texels = texels_of(mesh.uvs, SIZE)
    truth = paint(unit(texels.of(mesh.vertices[mesh.triangles])))
    place = tuple(texels.place.T)
    assert texture.colours is not None
    np.testing.assert_array_equal(texture.colours[..., 3] > 0, texture.seen)
    assert texture.seen[place].mean() > 0.99
    assert np.abs(texture.colours[place][:, :3] - truth).max() < 0.02


def test_views_that_differ_in_brightness_are_blended_in_linear_light() -> None:
    """Seen squarely by two alike: the mean."""
    mesh = sphere_mesh(48, 24)
    views = [painted_view((0, 0, 1), 0.5), painted_view((0, 0, 1), 1.0)]
    texture, texels = bake_normals(mesh, views, size=SIZE), texels_of(mesh.uvs, SIZE)
    points = unit(texels.of(mesh.vertices[mesh.triangles]))
    ahead = points[:, 2] > 0.5
    assert texture.colours is not None
    found = texture.colours[tuple(texels.place[ahead].T)][:, :3]
    assert np.abs(found - 0.75 * paint(points[ahead])).max() < 0.02


# What the views' channels were multiplied by, by mistake; the geometric mean is 1 in each channel.
WRONG = np.exp([[0.5, 0.3, 0], [-0.4, -0.5, 0.1], [0.2, 0, -0.3], [-0.3, 0.2, 0.4], [0, 0, -0.2], [0, 0, 0]])


def wrongly_exposed(rng: np.random.Generator) -> list[View]:
    """The painted sphere from six sides, each with a gain of its own and highlights that the others do not see."""
    views = []
    for side, wrong in zip(SIX_SIDES, WRONG, strict=True):
        view = painted_view(side, 0.4)
        highlights = rng.random(view.normals.mask.shape) < 0.1
        assert view.colours is not None
        colours = view.colours * wrong * np.where(highlights, 1.5, 1)[..., None]
        views.append(replace(view, colours=colours.astype(np.float32)))
    return views


def test_wrong_gains_are_found_from_what_the_views_share() -> None:
    matched = matched_views(wrongly_exposed(np.random.default_rng(1)), [sphere_mesh(48, 24)], 0.05)
    truth = [painted_view(side, 0.4).colours for side in SIX_SIDES]
    for view, true in zip(matched, truth, strict=True):
        assert view.colours is not None and true is not None
        np.testing.assert_allclose(np.nanmedian(view.colours / true, axis=(0, 1)), 1, atol=0.02)


def test_matching_keeps_one_white_balance_and_clips_nothing() -> None:
    """Views whose colours are right but for one that is eight times darker: that one may not lift the others."""
    views = [painted_view(side, 1 if number else 0.125) for number, side in enumerate(SIX_SIDES)]
    matched = matched_views(views, [sphere_mesh(48, 24)], 0.05)
    pairs = zip(matched, views, strict=True)
    gains = np.array([np.nanmedian(one.colours / view.colours, axis=(0, 1)) for one, view in pairs])
    np.testing.assert_allclose(gains[0] / gains[1:], 8, rtol=0.02)
    np.testing.assert_allclose(gains / gains[:, :1], 1, rtol=0.02)
    assert max(np.nanpercentile(one.colours, 99.5) for one in matched) < 1.01


def test_views_that_share_nothing_stay_as_they_are(caplog: pytest.LogCaptureFixture) -> None:
    views = [painted_view((1, 0, 0), 0.5), painted_view((-1, 0, 0))]
    for view, as_it_was in zip(matched_views(views, [sphere_mesh()], 0.05), views, strict=True):
        assert view.colours is not None and as_it_was.colours is not None
        np.testing.assert_allclose(view.colours, as_it_was.colours, rtol=1e-5)
    assert "2 of 2 views share too little of the surface" in caplog.text


def shuffled(mesh: Mesh, parts: int) -> Mesh:
    """The mesh with its UVs cut into vertical strips, which take one another's places upside down in random order."""
    across = (mesh.uvs[..., 0] - 0.01) / 0.98 * parts
    strip = across.mean(axis=1).astype(int)
    to = np.random.default_rng(2).permutation(parts)[strip]
    within = across - strip[:, None]
    u = (to[:, None] + 0.05 + 0.9 * within) / parts
    return Mesh(mesh.vertices, mesh.triangles, mesh.corner_normals, np.stack([1 - u, 1 - mesh.uvs[..., 1]], axis=-1))


@pytest.mark.parametrize("size", [200, 900])
def test_colours_go_on_along_the_surface_whatever_its_islands(size: int) -> None:
    """On the far half of a sphere, y / (1 - x) is the harmonic function that is y on the rim."""
    mesh = shuffled(sphere_mesh(48, 24), 16)
    texture, texels = bake_normals(mesh, [painted_view((1, 0, 0))], size=size), texels_of(mesh.uvs, size)
    points = unit(texels.of(mesh.vertices[mesh.triangles]))
    far = (points[:, 0] < -0.2) & (np.abs(points[:, 2]) < 0.7)
    assert texture.colours is not None
    found = texture.colours[tuple(texels.place[far].T)]
    assert not found[:, 3].any()
    harmonic = 0.5 + 0.4 * points[far, 1] / (1 - points[far, 0])
    off = np.abs(found[:, 1] - harmonic)
    assert off.mean() < 0.04 and off.max() < 0.12


def test_colours_go_on_across_the_seams_of_every_tile() -> None:
    mesh = shuffled(sphere_mesh(24, 12), 16)
    moved = replace(mesh, uvs=mesh.uvs + np.float32([1, 0]), given_tangents=mesh.tangents)
    baked = []
    for one, tile in ((mesh, 1001), (moved, 1002)):
        chosen = [found for found in texture_sets([one], tiles=True) if found.tile == tile]
        baked += bake_texture_sets([one], [painted_view((1, 0, 0))], chosen, BakeSettings(SIZE))
    (_, first), (_, second) = baked
    assert first.colours is not None and second.colours is not None
    inside = first.covered & second.covered
    assert np.abs(first.colours - second.colours)[inside].mean() < 1e-3


def test_an_island_that_nothing_seen_touches_has_the_mean_colour() -> None:
    mesh = sphere_mesh(24, 12)
    alone = mesh.vertices + np.array([0, 8, 0])
    both = Mesh(
        np.concatenate([mesh.vertices, alone]),
        np.concatenate([mesh.triangles, mesh.triangles + len(mesh.vertices)]),
        np.concatenate([mesh.corner_normals] * 2),
        np.concatenate([mesh.uvs * (0.5, 1), mesh.uvs * (0.5, 1) + (0.5, 0)]),
    )
    texture = bake_normals(both, [painted_view(side) for side in ((1, 0, 0), (-1, 0, 0))], size=SIZE)
    assert texture.colours is not None
    right, covered = (values[:, SIZE // 2 :] for values in (texture.colours, texture.covered))
    assert not right[covered][:, 3].any()
    assert np.abs(right[covered][:, :3] - texture.colours[texture.seen][:, :3].mean(axis=0)).max() < 0.02


def test_bake_writes_the_albedo_beside_the_texture(tmp_path: Path, mpsnet) -> None:
    """A plate of two colours before two cameras; where one albedo is transparent, the other one tells. They differ in
    exposure and tint, and meet in the middle."""
    mesh: Mesh = plane()
    write_mesh(tmp_path / "plate.npz", mesh)
    camera: Camera = camera_looking((0, 0, 1), size=64, reach=1.0)
    write_camera(tmp_path / "camera.json", camera)
    mask = np.ones((64, 64), bool)
    write_normals(tmp_path / "n.png", NormalMap(np.broadcast_to([0, 0, 1.0], (64, 64, 3)), mask))
    colours = np.where(np.arange(64)[None, :, None] < 32, [0.6, 0.3, 0.1], [0.1, 0.2, 0.5]) * np.ones((64, 1, 1))
    holed = mask.copy()
    holed[10:20, 10:20] = False
    write_albedo(tmp_path / "holed.png", colours * holed[..., None], holed)
    wrong = np.array([1.5, 1.2, 1.3])
    write_albedo(tmp_path / "whole.exr", colours / wrong**2, mask)
    view = ["--view", f"{tmp_path / 'camera.json'}={tmp_path / 'n.png'}"]
    command = ["bake", "--mesh", tmp_path / "plate.npz", *view, *view, "--albedo", tmp_path / "holed.png"]
    command += ["--albedo", tmp_path / "whole.exr", "--size", "64", "--level", "off"]
    done = mpsnet(*command, "-o", tmp_path / "plate.png", "--progress", "json")
    assert done.returncode == 0, done.stderr
    _, last = events(done.stdout)
    assert last["result"]["outputs"][0]["albedo"] == str(tmp_path / "plate_albedo.png")
    picture = oiio.ImageBuf(str(tmp_path / "plate_albedo.png"))
    assert picture.spec().get_string_attribute("oiio:ColorSpace").lower().startswith("srgb")
    found, inner = picture.get_pixels(oiio.FLOAT), np.r_[1:30, 34:63]
    expected = linear_to_srgb(colours / wrong)
    np.testing.assert_allclose(found[1:63, inner], expected[1:63, inner], atol=0.005)


test_bad_colours_get_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: b.bake("--albedo", b / "a.png", "--albedo", b / "b.png"), "there are 1 views but 2 albedos"),
        ("albedo of another size", lambda b: b.bake("--albedo", b.photo("a.exr", SPHERE.image[:8])), "the colours are"),
        (lambda b: b.bake("--albedo", b.photo("texture_albedo.png", kind="uint8")), "overwrite…texture_albedo.png"),
        (
            "colours of some views only",
            lambda b: bake_normals(
                Mesh(**SQUARE),
                [
                    View(read_camera(b.camera()), read_normals(b.normals()), colours)
                    for colours in (None, np.ones((16, 16, 3), np.float32))
                ],
            ),
            "some views have colours and others none; give all of them colours, or none",
        ),
    ]
)
