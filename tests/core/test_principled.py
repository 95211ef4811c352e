"""The principled reflectance by itself: energy, reciprocity, closed forms. (Against Cycles: tests/addon.)"""

from dataclasses import replace

import numpy as np
import pytest
from directions import Array, hemisphere, up

from mpsnet_core.synthesis.reflectance import PrincipledBsdf
from mpsnet_core.synthesis.reflectance.principled import fresnel_dielectric, ior_of_reflectance, reflectance_of_ior
from mpsnet_core.synthesis.scene_description import Material

WHITE = (1.0, 1.0, 1.0)
MATERIALS = {
    "matt": Material(specular=0.0, base_color=WHITE),
    "rough plastic": Material(base_color=WHITE, roughness=0.7),
    "plastic": Material(base_color=WHITE, roughness=0.3, specular=1.0),
    "dense plastic": Material(base_color=WHITE, ior=2.5, roughness=0.5),
    "metal": Material(base_color=WHITE, metallic=1.0, roughness=0.4),
    "rough metal": Material(base_color=WHITE, metallic=1.0, roughness=1.0),
    "half metal": Material(base_color=WHITE, metallic=0.5, roughness=0.6),
    "cloth": Material(base_color=WHITE, sheen=1.0, specular=0.0),
    "coat": Material(base_color=WHITE, coat=1.0, coat_roughness=0.3),
    "all": Material(base_color=WHITE, metallic=0.3, sheen=0.5, coat=0.5, coat_roughness=0.4, subsurface=0.5),
}


def albedo(material: Material, cosine: float) -> Array:
    """Share of light from everywhere that is reflected to a viewer at `cosine`, (3,): a sum over directions of light,
    denser towards the horizon and about the mirror direction than even ones would be."""
    sine = np.sqrt(1 - cosine**2)
    view = np.array([sine, 0.0, cosine])
    # Light directions as mirrored views by facets on a fine grid of half vectors, with d(light) = 4 (v.h) d(half).
    steps = 300
    tilt = ((np.arange(steps) + 0.5) / steps) ** 2 * np.pi / 2
    turn = (np.arange(steps) + 0.5) / steps * np.pi
    tilt, turn = (grid.ravel() for grid in np.meshgrid(tilt, turn))
    half = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
    area = np.sin(tilt) * np.sqrt(tilt * np.pi / 2) * 2 / steps * np.pi / steps
    on_facet = half @ view
    lights = 2 * on_facet[:, None] * half - view
    weight = np.where(on_facet > 0, 4 * on_facet * area * np.maximum(lights[:, 2], 0), 0)
    views = np.tile(view, (len(lights), 1))
    return 2 * weight @ PrincipledBsdf(material)(up(len(lights)), lights, views).astype(float)


def test_matt_is_lambertian() -> None:
    material = Material(specular=0.0, base_color=(0.2, 0.5, 0.8))
    found = PrincipledBsdf(material)(up(1000), hemisphere(1000, 1), hemisphere(1000, 2))
    assert np.allclose(found, np.array([0.2, 0.5, 0.8]) / np.pi, rtol=1e-5)


@pytest.mark.parametrize("name", MATERIALS)
def test_white_furnace(name: str) -> None:
    """What is white reflects all light, at every roughness: nothing is lost or won between facets and layers. Cycles
    holds its layers' shares in tables, as is done here, and both are so much off at grazing views."""
    for cosine in (0.1, 0.5, 1.0):
        assert albedo(MATERIALS[name], cosine) == pytest.approx(np.ones(3), abs=0.01)


def test_highlight_of_a_facing_mirror_has_its_closed_form() -> None:
    """Light, viewer and normal in one line: F0 / (4 pi alpha^2), and what comes back after further reflections."""
    for roughness in (0.2, 0.5):
        material = Material(base_color=(0.0, 0.0, 0.0), roughness=roughness)
        found = PrincipledBsdf(material)(up(1), up(1), up(1))
        assert found == pytest.approx(np.full((1, 3), 0.04 / (4 * np.pi * roughness**4)), rel=0.02)


def test_fresnel_has_its_known_values() -> None:
    assert fresnel_dielectric(np.ones(1), 1.5) == pytest.approx(0.04)
    assert fresnel_dielectric(np.zeros(1), 1.5) == pytest.approx(1)
    # At Brewster's angle only one polarisation is reflected: ((n^2 - 1) / (n^2 + 1))^2 / 2.
    brewster = np.cos(np.arctan(1.5))
    assert fresnel_dielectric(np.array([brewster]), 1.5) == pytest.approx((1.25 / 3.25) ** 2 / 2)
    # Out of glass, everything is reflected beyond the critical angle.
    assert fresnel_dielectric(np.array([0.7]), 1 / 1.5) == pytest.approx(1)
    assert ior_of_reflectance(reflectance_of_ior(1.8)) == pytest.approx(1.8)


@pytest.mark.parametrize("roughness", [0.0, 0.03, 1.0])
@pytest.mark.parametrize("name", MATERIALS)
def test_reflectance_is_finite_for_every_pair_of_directions(name: str, roughness: float) -> None:
    """Grazing, mirrored, equal, opposite, zero and broken vectors."""
    m = replace(MATERIALS[name], roughness=roughness, sheen_roughness=roughness, coat_roughness=roughness)
    views = hemisphere(600, 8)
    views[::3, 2] *= 1e-7
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    mirrored = views * [-1, -1, 1]
    special = np.array([[0, 0, 1], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 1], [0, 0, -1], [1, 0, 1e-30]])
    bsdf = PrincipledBsdf(m)
    with np.errstate(invalid="ignore", over="ignore"):
        for lights in (views, mirrored, -views, hemisphere(600, 9), *(np.tile(row, (600, 1)) for row in special)):
            for found in (bsdf(up(600), lights, views), bsdf(up(600), views, lights)):
                assert np.isfinite(found).all() and (found >= 0).all()
                below = ~((lights[:, 2] > 0) & (views[:, 2] > 0))
                assert (found[below] == 0).all()


def test_paint_multiplies_the_base_colour_and_leaves_the_gloss() -> None:
    normals, lights, views = up(200), hemisphere(200, 10), hemisphere(200, 11)
    paint = hemisphere(200, 12)
    painted = PrincipledBsdf(Material(base_color=(0.4, 0.5, 0.6), coat=0.5))(normals, lights, views, paint)
    for row in range(0, 200, 20):
        colour = tuple(np.clip(np.array([0.4, 0.5, 0.6]) * paint[row], 0, 1).tolist())
        alone = PrincipledBsdf(Material(base_color=colour, coat=0.5))  # type: ignore[arg-type]
        one = slice(row, row + 1)
        assert np.allclose(alone(normals[one], lights[one], views[one]), painted[one], rtol=1e-5)
