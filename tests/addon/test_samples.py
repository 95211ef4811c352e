"""Samples that Cycles renders, against what is known of them without Cycles."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.training.samples.render import render_sample
from blender_addon.training.samples.scene import open_objects
from mpsnet_core import Camera, InputError, published_rig
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.synthesis.scene_description import Bump, Material, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.pattern import material_weights
from mpsnet_core.synthesis.shapes.shape import Shape, joined, smooth_shape

from .rendering import principled

SIZE = 64
MATT = {"Specular IOR Level": 0.0}
WHITE = Material(base_color=(0.8, 0.8, 0.8), roughness=1.0, specular=0.0)
RED, GREEN, BLUE = (replace(WHITE, base_color=color) for color in ((0.8, 0, 0), (0, 0.8, 0), (0, 0, 0.8)))


def camera(projection: str, distance: float = 10.0, size: int = SIZE) -> Camera:
    """Sees a unit sphere at the origin, off the picture's middle."""
    pose = np.eye(4)
    pose[2, 3] = distance
    focal = size / 2.4 * (1 if projection == "orthographic" else np.sqrt(distance**2 - 1))
    return Camera(projection, size, size, [focal, focal], [size * 0.53, size * 0.48], pose)


def recipe(projection: str = "orthographic", **changes) -> SceneDescription:
    plain = SceneDescription(
        seed=1,
        number=2,
        shape={"kind": "test"},
        rotation=np.eye(3),
        camera=camera(projection),
        light_directions=published_rig(slant=40, first_tilt=20).directions,
        light_sizes=np.zeros(3),
        materials=(WHITE,),
    )
    return replace(plain, **changes)


def turned(degrees: float) -> np.ndarray:
    """About the x axis, then about z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def sphere(radius: float = 1.0, centre: tuple[float, float, float] = (0, 0, 0), rings: int = 64) -> Shape:
    """A sphere of rings and twice as many segments, with exact normals."""
    slant, tilt = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False))
    points = np.stack([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)], -1).reshape(-1, 3)
    column, row = np.meshgrid(np.arange(2 * rings), np.arange(rings), indexing="ij")
    a, b = column * (rings + 1) + row, (column + 1) % (2 * rings) * (rings + 1) + row
    triangles = np.concatenate(
        [
            np.stack(t, -1)[k].reshape(-1, 3)
            for k, t in ((np.s_[:, :-1], (a, a + 1, b + 1)), (np.s_[:, 1:], (a, b + 1, b)))
        ]
    ).astype(np.int32)
    return smooth_shape(points * radius + centre, triangles, points)


def seen_sphere(view: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals and depth of the unit sphere at the pixels' middles, and the pixels well inside its outline."""
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    origins, directions = view.rays(np.stack([x.ravel(), y.ravel()], 1))
    half = (origins * directions).sum(1)
    root = half**2 - (origins**2).sum(1) + 1
    points = origins + (-half - np.sqrt(np.maximum(root, 0)))[:, None] * directions
    shape = (view.height, view.width)
    depth = view.world_from_camera[2, 3] - points[:, 2]
    return points.reshape(*shape, 3), depth.reshape(shape), (root > 0.1).reshape(shape)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_matt_sphere_is_as_the_formulas_say(projection, tmp_path):
    told = recipe(projection, rotation=turned(50), camera=camera(projection, 4.0))
    sample = render_sample(told, sphere(), 16, tmp_path / "sample.exr")
    normals, depth, inside = seen_sphere(told.camera)
    assert inside.mean() > 0.4 and (sample.alpha[inside] == 1).all()
    assert angular_error(sample.normals, normals)[inside].max() < 0.5
    assert np.abs(sample.depth - depth)[inside].max() < 0.003
    cosines = np.moveaxis(normals @ told.light_directions.T, -1, 0)
    expected = 0.8 * np.maximum(cosines, 0)
    for light, truth in zip(sample.lights, expected, strict=True):
        assert np.abs(light - truth[..., None])[inside].mean() < 0.01 * truth[inside].mean()
        assert (light - truth[..., None])[inside].mean() == pytest.approx(0, abs=0.002)
    sure = inside & (np.abs(cosines) > 0.03).all(axis=0)
    assert ((sample.lit > 0.5) == (cosines > 0))[:, sure].all()
    assert (sample.lit[:, sure] < 0.5).any()
    assert (sample.material[inside] == 0).all()
    outside = sample.alpha == 0
    assert outside.mean() > 0.1 and (sample.material[outside] == -1).all()
    assert not (sample.lights[:, outside].any() or sample.normals[outside].any() or sample.depth[outside].any())
    assert [path.name for path in tmp_path.iterdir()] == []


def test_one_render_shows_what_three_of_a_light_each_show(tmp_path):
    """With cast shadows, penumbrae, gloss and light between the spheres."""
    shape = joined([sphere(0.7, (-0.3, 0, 0)), sphere(0.4, (0.3, 0.3, 0.6))])
    materials = (Material(base_color=(0.7, 0.4, 0.2), roughness=0.4), Material(metallic=1.0, roughness=0.3))
    told = recipe(materials=materials, light_sizes=np.full(3, 10.0), bounces=2, camera=camera("orthographic", size=48))
    told = replace(told, pattern=Pattern("stripes", scale=2.0, softness=0.3))
    together = render_sample(told, shape, 64, tmp_path / "sample.exr")
    for number in range(3):
        # The other two suns stand where they light nothing that is seen.
        away = np.where(np.arange(3)[:, None] == number, told.light_directions, [0, 0, -1])
        alone = render_sample(replace(told, light_directions=away), shape, 64, tmp_path / "sample.exr")
        ours, truth = together.lights[number], alone.lights[number]
        assert np.abs(ours - truth).mean() < 0.06 * truth.mean()
        assert ours.mean() == pytest.approx(truth.mean(), rel=0.01)
        blocks = [image.reshape(6, 8, 6, 8, 3).mean(axis=(1, 3)) for image in (ours, truth)]
        assert np.abs(blocks[0] - blocks[1]).max() < 0.03


def test_materials_lie_where_the_pattern_says(tmp_path):
    """Stripes and parts have no noise in them, and so are the same as the core's own."""
    cap = joined([sphere(0.8, (-0.2, 0, 0)), sphere(0.5, (0.5, 0, 0))])
    cap = replace(cap, parts=np.array([1, 6], np.int32)[cap.parts])
    for kind, shape in (("parts", cap), ("stripes", sphere())):
        pattern = Pattern(kind, scale=1.7, direction=(0.36, 0.48, 0.8))
        told = recipe(materials=(RED, GREEN, BLUE, WHITE), pattern=pattern, rotation=turned(30))
        sample = render_sample(told, shape, 16, tmp_path / "sample.exr")
        x, y = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
        origins, directions = told.camera.rays(np.stack([x.ravel(), y.ravel()], 1))
        points = (origins + sample.depth.ravel()[:, None] * directions) @ told.rotation
        ball = np.where(np.linalg.norm(points - [0.5, 0, 0], axis=1) < 0.501, 6, 1)
        weights = material_weights(pattern, 4, points, ball)
        expected = weights.argmax(axis=1).reshape(SIZE, SIZE)
        padded = np.pad(expected, 1, mode="edge")
        same = [padded[1 + r : SIZE + 1 + r, 1 + c : SIZE + 1 + c] == expected for r in (-1, 0, 1) for c in (-1, 0, 1)]
        sure = sample.mask & np.all(same, axis=0)
        assert (sample.material == expected)[sure].all() and len(np.unique(expected[sure])) >= 2
        colours = np.array([one.base_color for one in told.materials])[expected] > 0
        shown = sample.lights.sum(axis=0)
        lit = sure & (sample.lit.sum(axis=0) > 0.5)
        assert ((shown > 1e-4) == colours)[lit].all()


@pytest.mark.parametrize("kind", ["noise", "voronoi"])
def test_materials_of_a_random_pattern_have_their_share(kind, tmp_path):
    pattern = Pattern(kind, scale=6.0, softness=0.5, warp=0.3, seed=7)
    sample = render_sample(recipe(materials=(RED, GREEN, BLUE), pattern=pattern), sphere(), 16, tmp_path / "sample.exr")
    shares = np.bincount(sample.material[sample.mask], minlength=3) / sample.mask.sum()
    assert ((shares > 0.15) & (shares < 0.55)).all()
    # Soft edges: neighbours' colours meet in a good share of the pixels, and sum to one.
    shown, inside = sample.lights.sum(axis=0), sample.mask & (sample.lit.min(axis=0) == 1)
    colours = shown[inside] / shown[inside].sum(axis=1, keepdims=True)
    assert 0.1 < (colours.max(axis=1) < 0.95).mean() < 0.9
    whole = 0.8 * sample.normals[inside] @ recipe().light_directions.sum(axis=0)
    assert np.abs(shown[inside].sum(axis=1) / whole - 1).mean() < 0.02


def test_the_bump_is_in_the_normals(tmp_path):
    bumpy = recipe(bump=Bump(height=0.01, scale=8.0, seed=2))
    sample = render_sample(bumpy, sphere(), 64, tmp_path / "sample.exr")
    smooth, _, inside = seen_sphere(bumpy.camera)
    lit = inside & (np.einsum("hwc,kc->khw", smooth, bumpy.light_directions) > 0.25).all(axis=0)
    bend = angular_error(sample.normals, smooth)[lit]
    assert 2 < bend.mean() < 15
    by_light = normalised(sample.lights.mean(axis=-1).transpose(1, 2, 0) @ np.linalg.inv(bumpy.light_directions).T)
    assert angular_error(by_light, sample.normals)[lit].mean() < 0.25 * bend.mean()


def test_a_faceted_shape_is_flat_and_a_subsurface_one_glows_beyond_the_terminator(tmp_path):
    ball = sphere(rings=5)
    a, b, c = ball.vertices[ball.triangles].transpose(1, 0, 2)
    flat = normalised(np.cross(b - a, c - a)).astype(np.float32)
    faceted = replace(ball, corner_normals=np.repeat(flat[:, None], 3, axis=1))
    sample = render_sample(recipe(), faceted, 4, tmp_path / "sample.exr")
    distances = angular_error(sample.normals[sample.mask][:, None], flat[None]).min(axis=1)
    assert np.median(distances) < 0.05

    soft = recipe(materials=(Material(subsurface=1.0, subsurface_radius=2.0),))
    sample = render_sample(soft, sphere(), 16, tmp_path / "sample.exr")
    normals, _, inside = seen_sphere(soft.camera)
    cosine = normals @ soft.light_directions[0]
    assert sample.lights[0][inside & (cosine > -0.15) & (cosine < -0.05)].mean() > 0.02
    assert angular_error(sample.normals, normals)[inside].mean() < 0.2


def test_denoised_light_is_nearer_to_the_truth_and_the_rest_is_as_it_was(tmp_path):
    soft = recipe(
        materials=(Material(subsurface=1.0, base_color=(0.8, 0.5, 0.4)), RED, GREEN, BLUE),
        pattern=Pattern("stripes", scale=1.0),
        bounces=1,
    )
    noisy, denoised = (
        render_sample(soft, sphere(), 8, tmp_path / "s.exr", denoise=denoise) for denoise in (False, True)
    )
    truth = render_sample(soft, sphere(), 256, tmp_path / "s.exr")
    before, after = (np.abs(sample.lights - truth.lights).mean() for sample in (noisy, denoised))
    assert after < 0.8 * before
    for name in ("normals", "depth", "alpha", "material", "lit"):
        assert np.allclose(getattr(noisy, name), getattr(denoised, name), atol=1e-4), name
    assert not list(tmp_path.iterdir())

    # Direct light has no noise that is worth it.
    plain = [render_sample(recipe(), sphere(), 4, tmp_path / "s.exr", denoise=denoise) for denoise in (False, True)]
    assert np.abs(plain[0].lights - plain[1].lights).max() < 1e-5


def test_the_same_recipe_gives_the_same_picture_and_leaves_nothing_behind(tmp_path):
    told = recipe(pattern=Pattern("noise"), materials=(RED, GREEN), bump=Bump(0.01), light_sizes=np.full(3, 5.0))
    first = render_sample(told, sphere(), 8, tmp_path / "sample.exr")
    counts = held()
    again = render_sample(told, sphere(), 8, tmp_path / "sample.exr")
    other = render_sample(replace(told, number=3), sphere(), 8, tmp_path / "sample.exr")
    assert np.abs(first.lights - again.lights).max() < 1e-4
    assert np.abs(first.lights - other.lights).max() > 1e-3
    assert held() == counts


def held() -> dict[str, int]:
    """How many of each kind of data Blender holds."""
    kinds = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


# --- the scene's own objects ------------------------------------------------------------------------------------------


@pytest.fixture
def scene_file(tmp_path):
    """A red and a green ball of radius 3, the green one a stretched child of the red one, and a lamp that glows."""
    for name, color, place in (("Red", (0.8, 0, 0), (20, 0, 3)), ("Green", (0, 0.8, 0), (26, 0, 3))):
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=3, location=place)
        bpy.context.object.name = name
        bpy.context.object.data.materials.append(principled(name, color, **MATT))
        bpy.ops.object.shade_smooth()
    red, green = bpy.data.objects["Red"], bpy.data.objects["Green"]
    green.parent, green.matrix_parent_inverse = red, red.matrix_world.inverted()
    red.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 9))
    bpy.context.object.name = "Lamp"
    hidden = bpy.data.objects.new("Hidden", bpy.context.object.data.copy())
    bpy.context.collection.objects.link(hidden)
    hidden.hide_viewport = True
    lamp = principled("Lamp", (1, 1, 1), **MATT, **{"Emission Strength": 5.0})
    bpy.context.object.data.materials.append(lamp)
    path = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return path


def test_own_objects_are_brought_to_unit_size_with_their_own_materials(scene_file, tmp_path):
    objects = open_objects(scene_file, ("Red", "Green"))
    used = objects.vertices[np.unique(objects.triangles)]
    assert (
        np.linalg.norm(used, axis=1).max() == pytest.approx(1)
        and np.abs(used.min(axis=0) + used.max(axis=0)).max() < 1e-6
    )
    assert len(objects.meshes[0][0].vertices) > 642 or len(objects.meshes[1][0].vertices) > 642  # the modifier's
    told = recipe(materials=())
    counts = held()
    sample = render_sample(told, objects, 16, tmp_path / "sample.exr")
    assert held() == counts
    middle, inside = SIZE // 2, sample.mask & (sample.lit.min(axis=0) == 1)
    shown = sample.lights.sum(axis=0)
    left = np.arange(SIZE)[None] < told.camera.centre[0]
    assert set(sample.material[inside & left]) != set(sample.material[inside & ~left]) and inside[:, middle:].any()
    assert (shown[..., 0] > 1e-3)[inside & left].all() and (shown[..., 1] < 1e-4)[inside & left].all()
    assert (shown[..., 1] > 1e-3)[inside & ~left].all()
    # Both balls have half the radius of the whole; their normals at their middles look at the camera.
    row, column = (int(place) for place in (told.camera.centre[1], told.camera.centre[0] - told.camera.focal[0] / 2))
    assert sample.normals[row, column, 2] > 0.99
    assert sample.depth[row, column] == pytest.approx(9.5, abs=0.01)
    denoised = render_sample(replace(told, bounces=1), objects, 16, tmp_path / "sample.exr", denoise=True)
    assert (denoised.material == sample.material)[inside].mean() > 0.98
    assert np.abs(denoised.lights - sample.lights)[:, inside].mean() < 0.02
    quarter = render_sample(
        replace(told, rotation=np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])), objects, 4, scene_file
    )
    assert quarter.mask[:, SIZE // 2].sum() > 2 * quarter.mask[SIZE // 2].sum()


@pytest.mark.parametrize(
    "names, sentence",
    [
        (("Red", "Lamp"), r'material "Lamp" of "Lamp" glows'),
        (("Blue",), r'scene.blend has no object "Blue"'),
        (("Red", "Hidden"), r'"Hidden" in .*scene.blend has no surface or is hidden in viewports'),
    ],
)
def test_objects_that_cannot_be_shown(names, sentence, scene_file):
    with pytest.raises(InputError, match=sentence):
        open_objects(scene_file, names)
