"""Shading against what geometry says: spheres, shadows, penumbrae and form factors, worked out without the core."""

import numpy as np
import pytest
from shaded_shapes import Lambert, ball, camera, plane_points, recipe, rectangle

from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Bump, Dirt, Material, Paint, Pattern
from mpsnet_core.synthesis.shading.indirect import lobe, reflect_light
from mpsnet_core.synthesis.shading.lights import Light
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes.shape import Shape, joined

FLOOR = rectangle((-2, -2, 0), (4, 0, 0), (0, 4, 0))


def sphere_normals(view, size: int) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) normals of the unit sphere and (H, W) whether the pixel's centre shows it, by its equation."""
    row, column = np.mgrid[:size, :size] + 0.5
    x, y = (column - size / 2) / view.focal[0], (size / 2 - row) / view.focal[1]
    far = view.world_from_camera[2, 3]
    if view.projection == "orthographic":
        start, along = np.stack([x, y, far + 0 * x], -1), np.broadcast_to([0.0, 0, -1], (size, size, 3))
    else:
        start, along = np.broadcast_to([0, 0, far], (size, size, 3)), np.stack([x, y, -1 + 0 * x], -1)
    a, b, c = (along**2).sum(-1), (start * along).sum(-1), (start**2).sum(-1) - 1
    inside = b * b - a * c > 0
    nearest = (-b - np.sqrt(np.where(inside, b * b - a * c, 0))) / a
    return start + nearest[..., None] * along, inside


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_matt_sphere_is_as_bright_as_the_cosine(projection: str) -> None:
    view = camera(96, projection)
    settings = recipe(96, camera=view)
    sample = synthesise(settings, ball(), [Lambert(0.7)])
    normals, inside = sphere_normals(view, 96)
    towards = view.world_from_camera[:3, 3] - normals if projection == "perspective" else np.array([0, 0, 1.0])
    cosine = (normals * towards).sum(-1) / np.linalg.norm(towards, axis=-1)
    facing = cosine > 0.2  # at its outline the mesh lies inside the sphere by a trifle
    assert (sample.alpha == inside)[facing & inside].all()
    seen = inside & facing
    assert angular_error(sample.normals, normals)[seen].max() < 0.05
    for light, direction, lit in zip(sample.lights, settings.light_directions, sample.lit, strict=True):
        cosine = normals @ direction
        assert np.abs(light - 0.7 * np.maximum(cosine, 0)[..., None])[seen].max() < 1e-3
        assert (lit == (cosine > 0))[seen & (np.abs(cosine) > 0.01)].all()
    distance = view.world_from_camera[2, 3]
    assert np.abs(sample.depth - (distance - normals[..., 2]))[seen].max() < 1e-3
    outside = sample.alpha == 0
    assert not sample.lights[:, outside].any() and not sample.normals[outside].any() and not sample.depth[outside].any()
    assert (sample.material[outside] == -1).all() and (sample.material[~outside] == 0).all()


def shadowed(points: np.ndarray, towards: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """(...) whether rays from points along unit vectors pass through a ball above them."""
    apart = centre - points
    along = (apart * towards).sum(-1)
    return (along > 0) & ((apart**2).sum(-1) - along**2 < radius**2)


def test_a_balls_shadow_lies_where_the_light_says() -> None:
    view, centre, radius = camera(128), np.array([0.1, 0.0, 0.5]), 0.3
    settings = recipe(128, camera=view)
    sample = synthesise(settings, joined([FLOOR, ball(radius, tuple(centre))]), [Lambert()])
    points = plane_points(view)
    floor = np.hypot(*(points - centre)[..., :2].transpose(2, 0, 1)) > radius * 1.02
    for lit, light, direction in zip(sample.lit, sample.lights, settings.light_directions, strict=True):
        expected = ~shadowed(points, direction, centre, radius)
        assert 0.02 < (~expected)[floor].mean() < 0.3
        # The ball is a mesh: a thousandth of its size less than the ball, a pixel is 0.016.
        sure = shadowed(points, direction, centre, radius * 0.99) == shadowed(points, direction, centre, radius * 1.01)
        assert (lit == expected)[floor & sure].all()
        assert np.abs(light[..., 0] - lit * direction[2])[floor].max() < 1e-5


def test_a_wide_light_has_a_penumbra_as_wide_as_the_light() -> None:
    view, centre, radius, size = camera(64), np.array([0.0, 0.0, 0.6]), 0.25, 12.0
    settings = recipe(64, camera=view, light_sizes=np.full(3, size))
    sample = synthesise(settings, joined([FLOOR, ball(radius, tuple(centre))]), [Lambert()])
    points = plane_points(view)
    floor = np.hypot(*(points - centre)[..., :2].transpose(2, 0, 1)) > radius * 1.02
    across = np.linspace(-1, 1, 31)
    places = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2)
    places = places[(places**2).sum(1) <= 1] * np.tan(np.radians(size / 2))
    for lit, light, direction in zip(sample.lit, sample.lights, settings.light_directions, strict=True):
        side = np.cross(direction, [1, 0, 0])
        side /= np.linalg.norm(side)
        towards = direction + places @ np.stack([side, np.cross(direction, side)])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        expected = np.mean([~shadowed(points, one, centre, radius) for one in towards], axis=0)
        penumbra = floor & (expected > 0.02) & (expected < 0.98)
        assert penumbra.mean() > 0.02
        assert np.abs(lit - expected)[penumbra].mean() < 0.04
        assert abs((lit - expected)[penumbra].mean()) < 0.01
        assert np.abs(lit - expected)[penumbra].max() < 0.3
        assert np.abs(lit - expected)[floor & ~penumbra].max() < 0.1
        assert np.abs(light[..., 0] - expected * direction[2])[penumbra].mean() < 0.03


@pytest.mark.parametrize("size", [0.0, 10.0])
def test_a_coarse_mesh_with_smooth_normals_casts_no_shadow_on_its_own_lit_side(size: float) -> None:
    settings = recipe(128, light_sizes=np.full(3, size))
    sample = synthesise(settings, ball(rows=8), [Lambert()])
    seen = sample.alpha > 0
    for lit, direction in zip(sample.lit, settings.light_directions, strict=True):
        cosine, reach = sample.normals @ direction, np.sin(np.radians(size / 2))
        assert lit[seen & (cosine > reach + 0.02)].min() == 1
        assert lit[seen & (cosine < -reach - 0.02)].max() == 0


@pytest.mark.parametrize(("bounces", "tolerance"), [(1, 0.02), (2, 0.04), (3, 0.08)])
def test_every_bounce_in_a_bowl_adds_half_the_albedo_of_the_one_before(bounces: int, tolerance: float) -> None:
    """From anywhere in a hollow sphere every part of it has the same form factor, its share of the sphere's area: in
    half a sphere light off the bowl is even, and each bounce brings albedo / 2 of the bowl's mean light."""
    whole = ball(rows=80)
    lower = whole.vertices[whole.triangles].mean(axis=1)[:, 2] < 0
    bowl = Shape(
        whole.vertices, whole.triangles[lower][:, ::-1], -whole.corner_normals[lower][:, ::-1], whole.parts[lower]
    )
    more, fewer = (synthesise(recipe(64, bounces=n), bowl, [Lambert(0.8)]) for n in (bounces, bounces - 1))
    # What passes the opening, pi times the cosine of the lights' slant, falls on the bowl's 2 pi.
    expected = 0.8 * np.cos(np.radians(40)) / 2 * (0.8 / 2) ** bounces
    added = (more.lights - fewer.lights)[:, more.alpha > 0]
    assert added.mean() == pytest.approx(expected, rel=tolerance)
    assert added.mean(axis=(1, 2)) == pytest.approx(np.full(3, expected), rel=3 * tolerance)


@pytest.mark.parametrize(
    ("roughness", "size", "slant"),
    [(0.6, 8.0, 35), (0.35, 10.0, 35), (0.15, 15.0, 35), (0.1, 1.0, 35), (0.5, 15.0, 70)],
)
def test_highlights_are_as_broad_as_their_lights(roughness: float, size: float, slant: float) -> None:
    """Against reflectance averaged over thousands of places on the light, of which some may be below the horizon."""
    plastic = load_reflectance(Material(base_color=(0.1, 0.1, 0.1), roughness=roughness))
    light = Light(direction_from_angles(slant, 20), size)
    rng = np.random.default_rng(3)
    normals = direction_from_angles(30 * np.sqrt(rng.random(400)), 360 * rng.random(400)).astype(np.float32)
    views = np.broadcast_to(np.array([0, 0, 1], np.float32), normals.shape)
    found = reflect_light(plastic, lobe(plastic).width, light, normals, views, None, rng.integers(64, size=400))
    across = np.linspace(-1, 1, 45)
    places = np.stack(np.meshgrid(across, across), -1).reshape(-1, 2)
    expected, total = np.zeros((400, 3)), np.zeros(400)
    towards = light.towards(places[(places**2).sum(1) <= 1])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    for one in towards:
        cosine = np.maximum(normals @ one, 0)
        expected += np.pi * plastic(normals, np.broadcast_to(one, normals.shape), views) * cosine[:, None]
        total += cosine
    above = normals @ light.direction > 0
    found, expected = found[above], expected[above] / total[above, None]
    assert expected.max() > 1.4 * np.median(expected)
    assert abs(found.mean() / expected.mean() - 1) < 0.01
    assert np.abs(found - expected).mean() < 0.05 * expected.mean()
    assert (np.abs(found - expected) / expected.max()).max() < 0.15


def test_albedo_is_measured_on_the_reflectance() -> None:
    assert np.abs(lobe(Lambert(0.6)).albedo - 0.6).max() < 1e-3
    assert lobe(Lambert(0.6)).width == np.inf
    mirror = lobe(load_reflectance(Material(base_color=(1, 1, 1), metallic=1.0, roughness=0.1)))
    assert np.abs(mirror.albedo - 1).max() < 0.03
    assert mirror.width < 0.03


def test_the_truth_is_the_bumped_normal_that_was_shaded() -> None:
    settings = recipe(96, bump=Bump(height=0.01, scale=10.0, seed=4))
    sample = synthesise(settings, ball(), [Lambert()])
    flat = synthesise(recipe(96), ball(), [Lambert()])
    seen = sample.alpha > 0
    turned = angular_error(sample.normals, flat.normals)[seen]
    assert 1 < turned.mean() < 10
    assert np.abs(np.linalg.norm(sample.normals[seen], axis=1) - 1).max() < 1e-5
    for light, lit, direction in zip(sample.lights, sample.lit, settings.light_directions, strict=True):
        expected = lit * np.maximum(sample.normals @ direction, 0)
        assert np.abs(light[..., 0] - expected)[seen].max() < 1e-4


def test_materials_paint_and_dirt_lie_on_the_surface() -> None:
    settings = recipe(64, materials=(Material(), Material()), pattern=Pattern("stripes", 4, direction=(1, 0, 0)))
    sample = synthesise(settings, ball(), [Lambert(0.2), Lambert(0.8)])
    seen = sample.alpha > 0
    assert {0, 1} == set(sample.material[seen])
    cosine = np.maximum(sample.normals @ settings.light_directions[0], 0)
    expected = np.where(sample.material == 0, 0.2, 0.8) * cosine
    assert np.abs(sample.lights[0, ..., 0] - expected)[seen].max() < 1e-4

    painted = synthesise(recipe(64, paint=Paint(0.5, 1.0, 2.0, 3)), ball(), [Lambert()])
    bright = seen & (cosine > 0.3)
    factors = painted.lights[0][bright] / cosine[bright][:, None]
    assert factors.std(axis=0).min() > 0.03 and 0.7 < factors.mean() < 1.3
    assert np.abs(factors[:, 0] - factors[:, 1]).mean() > 0.03

    dirty = synthesise(recipe(64, dirt=Dirt(0.4, (0.1, 0.2, 0.3), 4.0, 1)), ball(), [Lambert()])
    factors = dirty.lights[0][bright] / cosine[bright][:, None]
    assert factors.min(axis=0) == pytest.approx([0.1, 0.2, 0.3], abs=0.01)
    assert factors.max(axis=0) == pytest.approx([1, 1, 1], abs=0.01)


def test_supersampling_gives_coverage_and_premultiplied_light() -> None:
    settings = recipe(48)
    sample = synthesise(settings, ball(0.8), [Lambert()], supersampling=4)
    view = settings.camera
    assert sample.alpha.sum() / view.focal[0] ** 2 == pytest.approx(np.pi * 0.8**2, rel=2e-3)
    edge = (sample.alpha > 0) & (sample.alpha < 1)
    assert edge.sum() > 50
    assert np.abs(np.linalg.norm(sample.normals[edge], axis=1) - 1).max() < 1e-5
    assert (sample.lights[..., 0] <= sample.alpha + 1e-6).all()
    single = synthesise(settings, ball(0.8), [Lambert()])
    inner = (sample.alpha == 1) & (single.lit == sample.lit).all(axis=0)
    assert np.abs(sample.lights - single.lights)[:, inner].max() < 0.02


def test_the_same_recipe_gives_the_same_bytes() -> None:
    shape = joined([FLOOR, ball(0.3, (0.1, 0, 0.5), rows=40)])
    varied = {
        "light_sizes": np.full(3, 8.0),
        "bounces": 1,
        "materials": (Material(roughness=0.2), Material(base_color=(0.5, 0.2, 0.1))),
        "pattern": Pattern("voronoi", 3.0, 0.5, 0.3, seed=5),
        "bump": Bump(0.003, 20.0, 1),
    }
    reflectances = [load_reflectance(material) for material in varied["materials"]]
    first, again = (synthesise(recipe(64, **varied), shape, reflectances) for _ in range(2))
    other = synthesise(recipe(64, number=3, **varied), shape, reflectances)
    for name in ("lights", "normals", "depth", "alpha", "material", "lit"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
    assert first.lights.tobytes() != other.lights.tobytes()
    assert first.lights.dtype == first.normals.dtype == first.depth.dtype == first.lit.dtype == np.float32
    assert first.material.dtype == np.int32


def test_back_faces_are_shaded_as_if_they_faced_the_viewer() -> None:
    """A sheet seen from behind, as drapery may be."""
    sheet = rectangle((-0.5, -0.5, 0), (0, 1, 0), (1, 0, 0))  # faces -z
    settings = recipe(32)
    sample = synthesise(settings, sheet, [Lambert(0.5)])
    seen = sample.alpha > 0
    assert sample.normals[seen] == pytest.approx(np.broadcast_to([0, 0, 1], (seen.sum(), 3)), abs=1e-6)
    assert sample.lights[0, seen, 0] == pytest.approx(0.5 * settings.light_directions[0, 2], abs=1e-5)
