"""Synthesised samples against Cycles' of the same recipes: direct light alone, and with one bounce."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from blender_addon.training.samples.render import render_sample
from mpsnet_core import Camera, Sample
from mpsnet_core.arrays.mask_regions import dilated, eroded
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Material, SceneDescription
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes.shape import Shape, faceted_shape, joined, smooth_shape

SIZE = 96
MATT = Material(base_color=(0.8, 0.5, 0.3), specular=0.0, roughness=1.0)
PLASTIC = Material(base_color=(0.6, 0.3, 0.2), roughness=0.5)
BRIGHT = Material(base_color=(0.9, 0.9, 0.9), specular=0.0, roughness=1.0)


def ball(radius: float, centre: tuple[float, float, float]) -> Shape:
    mesh = trimesh.creation.icosphere(subdivisions=5)
    return smooth_shape(radius * mesh.vertices + centre, mesh.faces.astype(np.int32), mesh.vertices)


def concave() -> Shape:
    """Two balls that overlap, sunk into a slab."""
    slab = trimesh.creation.box((1.5, 1.5, 0.1), trimesh.transformations.translation_matrix((0, 0, -0.35)))
    ground = faceted_shape(slab.vertices, slab.faces.astype(np.int32))
    return joined([ground, ball(0.4, (-0.2, 0.1, 0.05)), ball(0.25, (0.25, -0.2, -0.1))])


def recipe(
    material: Material, light_size: float, projection: str = "orthographic", bounces: int = 0
) -> SceneDescription:
    """Seen from obliquely above, off the picture's middle."""
    pose = np.eye(4)
    pose[2, 3] = 4.0
    focal = np.full(2, SIZE / 2.1 * (1 if projection == "orthographic" else 4))
    c, s = np.cos(np.radians(50)), np.sin(np.radians(50))
    return SceneDescription(
        seed=1,
        number=2,
        shape={},
        rotation=np.array([[1, 0, 0], [0, c, s], [0, -s, c]]),
        camera=Camera(projection, SIZE, SIZE, focal, [SIZE * 0.51, SIZE * 0.48], pose),
        light_directions=direction_from_angles([40, 30, 50], [80, 210, 330]),
        light_sizes=np.full(3, light_size),
        materials=(material,),
        bounces=bounces,
    )


def both(told: SceneDescription, shape: Shape, samples: int, folder: Path) -> tuple[Sample, Sample]:
    synthesised = synthesise(told, shape, [load_reflectance(one) for one in told.materials], supersampling=2)
    return synthesised, render_sample(told, shape, samples, folder / "sample.exr")


def clear_of_edges(sample: Sample, other: Sample, light: int) -> np.ndarray:
    """Pixels away from the object's outline and from the edges of the light's shadows."""
    lit = sample.lit[light]
    edge = (lit > 0) & (lit < 1) | dilated(lit == 0, 1) & dilated(lit == 1, 1)
    return eroded(sample.mask & other.mask, 1) & ~dilated(edge, 1)


@pytest.mark.parametrize(
    ("shape", "material", "light_size", "projection"),
    [
        (ball(1.0, (0, 0, 0)), MATT, 0.0, "orthographic"),
        (ball(1.0, (0, 0, 0)), PLASTIC, 4.0, "perspective"),
        (concave(), PLASTIC, 3.0, "orthographic"),
        (concave(), MATT, 12.0, "perspective"),
    ],
    ids=["matt sphere", "rough plastic sphere", "concave plastic", "concave matt"],
)
def test_direct_light_is_as_in_cycles(shape, material, light_size, projection, tmp_path):
    ours, theirs = both(recipe(material, light_size, projection), shape, 96, tmp_path)
    assert np.abs(ours.alpha - theirs.alpha).mean() < 0.005
    for light in range(3):
        clear = clear_of_edges(ours, theirs, light)
        assert clear.sum() > 0.6 * ours.mask.sum()
        a, b = ours.lights[light][clear], theirs.lights[light][clear]
        assert np.abs(a - b).mean() < 0.02 * b.mean()
        bright = b.mean(axis=1) > 0.1
        assert (np.abs(a - b).mean(axis=1)[bright] / b.mean(axis=1)[bright]).mean() < 0.02
        assert a.mean() == pytest.approx(b.mean(), rel=0.01)
        assert np.abs(ours.lights[light] - theirs.lights[light]).mean() < 0.04 * theirs.lights[light].mean()
        assert np.abs(ours.lit[light] - theirs.lit[light]).mean() < 0.03


def test_a_bounce_adds_what_it_does_in_cycles(tmp_path):
    """A bright matt shape, whose shadows are lit by its other parts."""
    shape = concave()
    direct = both(recipe(BRIGHT, 3.0), shape, 48, tmp_path)
    ours, theirs = whole = both(recipe(BRIGHT, 3.0, bounces=1), shape, 64, tmp_path)
    inner = eroded(ours.mask & theirs.mask, 1)
    blocks = np.zeros((2, SIZE // 8, SIZE // 8))
    for light in range(3):
        added, expected = (
            np.where(inner, (one.lights - without.lights)[light].mean(axis=-1), 0)
            for one, without in zip(whole, direct, strict=True)
        )
        assert expected.mean() > 0.02 * theirs.lights[light].mean()
        assert added.mean() == pytest.approx(expected.mean(), rel=0.1)
        shadow = inner & ~dilated(ours.lit[light] > 0, 1)
        # At so few pixels smoothing reaches far across a shadow.
        assert added[shadow].mean() == pytest.approx(expected[shadow].mean(), rel=0.2, abs=0.003)
        for block, image in zip(blocks, (added, expected), strict=True):
            block[:] = image.reshape(SIZE // 8, 8, SIZE // 8, 8).mean(axis=(1, 3))
        assert np.abs(blocks[0] - blocks[1]).max() < 0.25 * blocks[1].max()
