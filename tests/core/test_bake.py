"""Baking, where the answer is known: spheres under any transform, and planes whose views disagree."""

from dataclasses import replace

import numpy as np
import pytest
from bad_input import SPHERE, gets_one_clear_sentence
from plane_views import SIX_SIDES, SIZE, constant_view, plane, plate_before_plane
from surface_shapes import camera_looking, first_on_sphere, sphere_mesh, sphere_view, texels_of, towards_camera
from synthetic import degrees_between
from uv_squares import squares

from mpsnet_core import Camera, InputError, Mesh, NormalMap, Texture, View, bake_normals, join_meshes
from mpsnet_core.bake import bake


def affine(scale: tuple[float, float, float], place: tuple[float, float, float] = (0.4, -2.0, 1.0)) -> np.ndarray:
    """Scaled, then turned about two axes, then moved."""
    a, b = np.radians(35), np.radians(-20)
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = about_z @ about_x @ np.diag(scale), place
    return pose


def in_object_space(texture: Texture, mesh: Mesh) -> np.ndarray:
    """(S, S, 3) what a renderer makes of the texture: x T + y B + z N with T and N interpolated over the triangle."""
    texels = texels_of(mesh.uvs, len(texture.vectors))
    x, y, z = texture.vectors[tuple(texels.place.T)].T[..., None]
    normal, tangent = texels.of(mesh.corner_normals), texels.of(mesh.tangents[..., :3])
    sign = mesh.tangents[texels.triangle, 0, 3:]
    out = np.full_like(texture.vectors, np.nan)
    out[tuple(texels.place.T)] = x * tangent + y * sign * np.cross(normal, tangent) + z * normal
    return out


@pytest.mark.parametrize("layout", ["whole", "mirrored"])
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("scale", [(1, 1, 1), (1.5, 0.6, 1.1), (-1, 1, 1.3)])
def test_one_view_gives_each_texel_its_normal(layout: str, projection: str, scale: tuple[float, float, float]) -> None:
    """The texel's point lies on a flat triangle; the view shows the smooth sphere there, so that is what to bake."""
    pose = affine(scale)
    mesh = sphere_mesh(layout=layout, world_from_object=pose)
    camera = camera_looking((0.9, -0.5, 0.4), projection, size=512, distance=6, target=tuple(pose[:3, 3]), reach=1.9)
    texels = texels_of(mesh.uvs, SIZE)
    points = texels.of(mesh.world_vertices[mesh.triangles])
    truth = first_on_sphere(points, towards_camera(camera, points), pose)
    shading = texels.of(mesh.corner_normals) @ np.linalg.inv(pose[:3, :3])
    cosine = (shading * towards_camera(camera, points)).sum(1) / np.linalg.norm(shading, axis=1)

    a, b, c = np.moveaxis(mesh.world_vertices[mesh.triangles], 1, 0)
    outwards = (np.cross(b - a, c - a) * np.sign(np.prod(scale)))[texels.triangle]
    faces_it = (outwards * towards_camera(camera, points)).sum(1) > 0

    place, view = tuple(texels.place.T), sphere_view(camera, pose)
    for space in ("object", "tangent"):
        texture = bake_normals(mesh, [view], size=SIZE, space=space, margin=0)
        assert texture.covered[place].all() and texture.covered.sum() == len(texels.place)
        seen = texture.seen[place]
        assert seen[cosine > 0.25].all() and not seen[~faces_it].any()
        assert np.linalg.norm(texture.vectors, axis=-1) == pytest.approx(1, abs=1e-5)
        baked = texture.vectors if space == "object" else in_object_space(texture, mesh)
        error = degrees_between(baked[place], truth)
        assert error[seen & (cosine > 0.4)].max() < 0.1
        assert error[seen].mean() < 0.1


def test_of_overlapping_halves_the_one_that_is_seen_is_baked(caplog: pytest.LogCaptureFixture) -> None:
    """Which half comes later in the mesh decides nothing: a sphere looks the same from both sides."""
    mesh = sphere_mesh(layout="overlapping")
    fractions = []
    with caplog.at_level("INFO", "mpsnet_core"):
        for side in SIX_SIDES[:4]:
            texture = bake_normals(mesh, [sphere_view(camera_looking(side))], size=SIZE, margin=0)
            fractions.append(texture.seen_fraction)
            assert degrees_between(texture.vectors, np.array([0, 0, 1.0]))[texture.seen].mean() < 2  # the facets
    assert min(fractions) > 0.4 and min(fractions[:2]) > 0.75, fractions
    assert abs(fractions[0] - fractions[1]) < 0.1 and abs(fractions[2] - fractions[3]) < 0.1
    assert any("overlap" in record.getMessage() for record in caplog.records)


def test_a_triangle_without_area_in_the_texture_owns_no_texel() -> None:
    """Its one value would be smeared along its line, over the texels of those that have an area."""
    square = plane()
    vertices = np.concatenate([square.vertices, [[-1, -1, 1], [0, 0, 2], [1, 1, 1]]])
    triangles = np.concatenate([square.triangles, [[4, 5, 6]]])
    line = np.array([[[0, 0], [0.5, 0.5], [1, 1]]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (3, 3, 3))
    mesh = Mesh(vertices, triangles, normals, np.concatenate([square.uvs, line]))
    view = constant_view(camera_looking((0, 0, 1)), [0.0, 0.0, 1.0])
    texture = bake_normals(mesh, [view], size=64, margin=0)
    assert texture.covered.all() and texture.seen_fraction > 0.9


def test_an_orthographic_camera_sees_the_same_from_within_as_from_afar() -> None:
    """What hides a plate hides it wherever along its axis the camera stands."""
    front, back = plane(), np.array([0.0, 0.0, -1.0])
    left, right = front.uvs * (0.5, 1), front.uvs * (0.5, 1) + (0.5, 0)
    mesh = join_meshes([replace(front, uvs=left), replace(front, vertices=front.vertices + back, uvs=right)])
    for height in (5.0, -0.5, -3.0):
        pose = np.eye(4)
        pose[2, 3] = height
        camera = Camera("orthographic", 64, 64, [24, 24], world_from_camera=pose)
        texture = bake_normals(mesh, [constant_view(camera, [0.0, 0.0, 1.0])], size=64, margin=0)
        assert texture.seen[:, :32].mean() > 0.95 and texture.seen[:, 32:].mean() < 0.05, height


@pytest.mark.parametrize(("depth", "told"), [(3.0, False), (0.0, False), (-3.0, True)])
def test_an_orthographic_camera_that_looks_away_from_the_mesh_is_reported(caplog, depth: float, told: bool) -> None:
    pose = np.eye(4)
    pose[2, 3] = depth
    camera = Camera("orthographic", 64, 64, [24, 24], world_from_camera=pose)
    bake_normals(plane(), [constant_view(camera, [0.0, 0.0, 1.0])], size=32)
    assert ("looks away from the mesh" in caplog.text) == told


def test_far_from_the_origin_the_bake_is_as_sharp() -> None:
    textures = []
    for place in (0.0, 1e6):
        pose = affine((1, 1, 1), (place, -place, place))
        mesh = sphere_mesh(world_from_object=pose)
        camera = camera_looking((0.9, -0.5, 0.4), target=(place, -place, place))
        textures.append(bake_normals(mesh, [sphere_view(camera, pose)], size=SIZE, space="object", margin=0))
    assert (textures[0].seen != textures[1].seen).mean() < 0.01
    both = textures[0].seen & textures[1].seen
    assert degrees_between(textures[0].vectors, textures[1].vectors)[both].max() < 0.1


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_six_views_give_the_whole_sphere(projection: str) -> None:
    pose = affine((1.2, 0.8, 1.0))
    mesh = sphere_mesh(48, 24, world_from_object=pose)
    views = [
        sphere_view(camera_looking(side, projection, target=tuple(pose[:3, 3]), reach=1.4), pose) for side in SIX_SIDES
    ]
    texture = bake_normals(mesh, views, size=SIZE, space="object", margin=0)
    assert texture.seen_fraction == 1
    texels = texels_of(mesh.uvs, SIZE)
    truth = texels.of(mesh.corner_normals)  # the smooth sphere's, but for the triangles' flatness
    error = degrees_between(texture.vectors[tuple(texels.place.T)], truth)
    assert error.mean() < 0.2 and error.max() < 2.5


def test_unseen_texels_keep_the_meshs_own_normal() -> None:
    mesh = sphere_mesh()
    view = sphere_view(camera_looking((1, 0, 0)))
    texels = texels_of(mesh.uvs, SIZE)
    place = tuple(texels.place.T)
    own = {"tangent": np.array([0, 0, 1.0]), "object": texels.of(mesh.corner_normals)}
    for space, expected in own.items():
        texture = bake_normals(mesh, [view], size=SIZE, space=space, margin=0)
        seen = texture.seen[place]
        assert 0.3 < seen.mean() < 0.6
        assert (degrees_between(texture.vectors[place], expected)[~seen]).max() < 0.05
        assert (texture.vectors[~texture.covered] == [0, 0, 1]).all()
        assert texture.seen_fraction == pytest.approx(seen.mean())


def test_pixels_outside_the_mask_take_no_part() -> None:
    """What lies beyond the mask is garbage; the texels next to its edge must not take any of it."""
    camera = camera_looking((0, 0, 1), size=64, reach=1.0)
    mask = np.zeros((64, 64), bool)
    mask[:, :32] = True
    vectors = np.broadcast_to(np.array([0.6, 0, 0.8]) @ camera.rotation, (64, 64, 3))
    left = View(camera, NormalMap(np.where(mask[..., None], vectors, [0, 0, 1.0]), mask))
    texture = bake_normals(plane(), [left], size=64, space="object", margin=0)
    share_seen = texture.seen.mean()
    assert 0.48 < share_seen < 0.55
    assert degrees_between(texture.vectors[texture.seen], [0.6, 0, 0.8]).max() < 1e-3


def test_the_more_confident_view_counts_more() -> None:
    cameras = [camera_looking((side, 0, 2), reach=1.6) for side in (1, -1)]
    normals = [[0.6, 0.0, 0.8], [0.0, 0.6, 0.8]]
    for first, second in ((1.0, 1.0), (0.75, 0.25), (0.1, 0.9)):
        views = [constant_view(cameras[0], normals[0], first), constant_view(cameras[1], normals[1], second)]
        texture = bake_normals(plane(), views, size=16, space="object")
        expected = first * np.array(normals[0]) + second * np.array(normals[1])
        # Views that expect an error leave the mesh a little weight.
        assert degrees_between(texture.vectors, expected).max() < (0.01 if first == second == 1 else 0.1)


def test_the_view_from_ahead_counts_more_than_the_glancing_one() -> None:
    ahead = constant_view(camera_looking((0, 0, 1)), [0.6, 0, 0.8])
    glancing = constant_view(camera_looking((0, 2, 1)), [0, 0.6, 0.8])
    texture = bake_normals(plane(), [glancing, ahead], size=16, space="object")
    to_ahead = degrees_between(texture.vectors, [0.6, 0, 0.8])
    assert (to_ahead < 0.2 * degrees_between(texture.vectors, [0, 0.6, 0.8])).all()


@pytest.mark.parametrize(("confidence", "kept"), [(1.0, True), (0.9, False)], ids=["exact", "doubtful"])
def test_at_a_grazing_angle_the_mesh_is_believed_more_than_a_doubtful_view(confidence: float, kept: bool) -> None:
    """Ahead, both views are believed."""
    for place, ahead in (((0, 0, 1.0), True), ((0, 2, 0.27), False)):
        view = constant_view(camera_looking(place), [0.6, 0, 0.8], confidence)
        texture = bake_normals(plane(), [view], size=16, space="object")
        from_view = degrees_between(texture.vectors, [0.6, 0, 0.8])
        if ahead or kept:
            assert from_view.max() < 0.1
        else:
            assert (from_view > 0.6 * np.degrees(np.arcsin(0.6))).all()


def test_what_another_part_hides_is_not_baked_onto_it() -> None:
    """A small square floats before a large one: the camera's normals reach only the one in front."""
    camera = camera_looking((0, 0, 1), size=200, reach=1.2)
    texture = bake_normals(plate_before_plane(), [constant_view(camera, [0.6, 0, 0.8])], size=200, margin=0)

    row, column = np.argwhere(texture.covered).T
    x, y = (column + 0.5) / 50 - 1, 3 - (row + 0.5) / 50
    at_back = (column < 100) & (row >= 100)
    hidden = at_back & (np.abs(x) < 0.28) & (np.abs(y) < 0.28)
    free = ~at_back | (np.maximum(np.abs(x), np.abs(y)) > 0.32)
    seen = texture.seen[row, column]
    assert hidden.sum() > 500 and not seen[hidden].any() and seen[free].all()


def test_what_stands_behind_a_perspective_camera_is_not_seen() -> None:
    """Two squares face the camera: one ahead of it, one at its back."""
    square = plane()
    mesh = Mesh(
        np.concatenate([square.vertices, square.vertices + np.array([0, 0, 10])]),
        np.concatenate([square.triangles, square.triangles[:, ::-1] + 4]),
        np.concatenate([square.corner_normals, -square.corner_normals]),
        np.concatenate([0.5 * square.uvs, 0.5 * square.uvs + 0.5]),
    )
    camera = camera_looking((0, 0, 1), "perspective", distance=4)
    texture = bake_normals(mesh, [constant_view(camera, [0, 0, 1.0])], size=64, margin=0)
    assert texture.seen[32:, :32].all() and not texture.seen[:32, 32:].any()


def test_the_margin_reaches_as_far_as_asked_and_changes_nothing_else() -> None:
    mesh, view = sphere_mesh(layout="mirrored"), sphere_view(camera_looking((1, 0, 0.3)))
    bare = bake_normals(mesh, [view], size=SIZE, margin=0, space="object")
    grown = bake_normals(mesh, [view], size=SIZE, margin=1, space="object")
    row, column = np.argwhere(bare.covered).T
    near = np.zeros((SIZE + 2, SIZE + 2), bool)
    for down in range(3):
        for right in range(3):
            near[row + down, column + right] = True
    ring = near[1:-1, 1:-1] & ~bare.covered
    changed = (bare.vectors != grown.vectors).any(axis=-1)
    assert ring.sum() > 100 and (changed[ring]).mean() > 0.95 and not changed[~ring].any()
    assert (grown.seen == bare.seen).all() and (grown.covered == bare.covered).all()


@pytest.mark.parametrize("samples", [1, 2])
def test_a_texture_made_a_few_rows_at_a_time_is_the_same(samples: int, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, views = sphere_mesh(), [sphere_view(camera_looking(side)) for side in SIX_SIDES[:2]]
    whole = bake_normals(mesh, views, size=SIZE, samples=samples)
    monkeypatch.setattr(bake, "POINTS_HELD", 7 * SIZE)
    by_rows = bake_normals(mesh, views, size=SIZE, samples=samples)
    for name, values in vars(whole).items():
        np.testing.assert_array_equal(getattr(by_rows, name), values)


def test_what_cannot_be_baked_is_refused_with_the_mend() -> None:
    mesh, view = plane(), constant_view(camera_looking((0, 0, 1)), [0, 0, 1.0])
    away = constant_view(camera_looking((0, 0, -1)), [0, 0, -1.0])
    corner = replace(view.normals, mask=np.arange(view.normals.mask.size).reshape(view.normals.mask.shape) == 0)
    for arguments, said in [
        (([],), "no view to bake; give at least one camera"),
        (([away],), "no view sees any of the mesh; check that the cameras and the mesh share one world"),
        (([away, replace(view, normals=corner)],), "within its mask, although the cameras see it; check that the mask"),
    ]:
        with pytest.raises(InputError, match=said):
            bake_normals(mesh, *arguments)
    with pytest.raises(InputError, match="camera is 64 x 64 but its normal map is 32 x 16"):
        View(camera_looking((0, 0, 1), size=64), NormalMap(np.ones((16, 32, 3)), np.ones((16, 32), bool)))
    speck = Mesh(mesh.vertices, mesh.triangles, mesh.corner_normals, 1e-3 * mesh.uvs)
    with pytest.raises(InputError, match="choose a larger size"):
        bake_normals(speck, [view], size=64)
    point = Mesh(mesh.vertices, mesh.triangles, mesh.corner_normals, 0 * mesh.uvs + 0.5)
    with pytest.raises(InputError, match="UVs have no area; unwrap it"):
        bake_normals(point, [view], size=64)
    inside_out = Mesh(mesh.vertices, mesh.triangles, -mesh.corner_normals, mesh.uvs)
    with pytest.raises(InputError, match=r"no view sees any of the mesh; .* and that its normals point outwards"):
        bake_normals(inside_out, [view], size=64)


@pytest.mark.parametrize("towards", [0.05, -0.9])
def test_what_a_camera_sees_of_a_card_does_not_depend_on_its_shading_normals(towards: float) -> None:
    """As on foliage. Tangent space holds what is not behind the shading normal."""
    mesh, shown = squares((0, 0), (2, 0), (4, 0), side=1.0), [0.3, 0.1, np.sqrt(0.9)]
    normals = mesh.corner_normals.copy()
    normals[:2] = 0, np.sqrt(1 - towards**2), towards
    mesh = replace(mesh, corner_normals=normals)
    view = constant_view(camera_looking((0, 0, 1), target=(0.5, 0.5, 0)), shown)
    texture = bake_normals(mesh, [view], size=16, space="object", margin=0)
    assert texture.seen.all() and degrees_between(texture.vectors, np.array(shown)).max() < 0.01
    if towards > 0:
        assert bake_normals(mesh, [view], size=16, margin=0).seen.all()
    else:
        with pytest.raises(InputError, match="in tangent space, normals must not point away"):
            bake_normals(mesh, [view], size=16, margin=0)


def test_a_texture_twice_as_wide_as_high() -> None:
    """Each of its texels is that of a square texture whose rows are twice as many, but for averaging."""
    mesh = sphere_mesh()
    for settings in ({}, {"fill": True, "samples": 2}, {"padding": "push-pull", "space": "object"}):
        views = [sphere_view(camera_looking((1, 0.2, 0.1)))]
        wide = bake_normals(mesh, views, size=(2 * SIZE, SIZE), **settings)  # type: ignore[arg-type]
        large = bake_normals(mesh, views, size=2 * SIZE, **settings)  # type: ignore[arg-type]
        assert wide.vectors.shape == (SIZE, 2 * SIZE, 3)
        both = wide.seen & large.seen[::2] & large.seen[1::2]
        assert both.mean() > 0.9 * wide.seen.mean() > 0.1
        between = large.vectors[::2] + large.vectors[1::2]
        assert degrees_between(wide.vectors, between)[both].mean() < 1


test_a_bad_bake_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("sizes differ", lambda b: b.bake(view=f"{b.camera()}={b.normals(size=32)}"), "camera is 16 x 16 but its"),
        ("a view without a camera", lambda b: b.bake(view=str(b.normals())), "normals.png is not CAMERA=NORMALS"),
        ("a view whose camera is missing", lambda b: b.bake(view=f"{b / 'c.json'}={b.normals()}"), "c.json does not"),
        ("size 0", lambda b: b.bake("--size", "0"), "a texture has no side of 0 texels"),
        ("size of three sides", lambda b: b.bake("--size", "8x8x8"), "--size 8x8x8 is not a size in pixels; give"),
        ("unknown space", lambda b: b.bake("--space", "world"), "space 'world' is not known; choose tangent or object"),
        ("8-bit EXR", lambda b: b.bake("--bits", "8", output="t.exr"), "t.exr…hold 16 or 32 bits per channel, not 8"),
        ("over the normals", lambda b: b.bake(output="normals.png"), "overwrite…normals.png…choose another output"),
        (
            "a photo for normals",
            lambda b: b.bake(view=f"{b.camera()}={b.photo('p.png', np.dstack([SPHERE.image, SPHERE.mask]), 'uint8')}"),
            "p.png is not a normal map",
        ),
        ("a folder with a suffix", lambda b: ((b / "t.png").mkdir(), b.bake(output="t.png")), "t.png…it is a folder"),
    ]
)
