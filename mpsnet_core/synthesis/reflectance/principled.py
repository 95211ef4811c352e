"""The reflectance of Blender's Principled BSDF, with the same parameters.

The layers are those of Cycles since Blender 4.0, from top to bottom: sheen, coat, then metal mixed with a dielectric
(specular over diffuse). A layer attenuates those below by its albedo, which depends on the view only. So individual
lobes are reciprocal, but their sum is not. Multiple scattering between facets is included ("Multiscatter GGX").

Differences from Cycles: subsurface scattering is diffuse reflection at the point of entry; sheen is a fit to the tables
of Cycles; base colour times paint is clamped to 1; there is no transmission, anisotropy or tint.
"""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TypeVar

import numpy as np

from mpsnet_core.arrays.types import F32, F64, Floats
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.errors import SettingsError
from mpsnet_core.synthesis.reflectance.hemisphere import AboveSurface
from mpsnet_core.synthesis.scene_description import Material

# --- GGX: the microfacet reflection of Cycles' Principled BSDF, and its directional albedo ----------------------------
# Roughness is the perceptual one; alpha of the distribution is its square.
#
# Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007; Heitz, "Understanding the
# Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT 2014. Multiple scattering: Kulla and Conty, "Revisiting
# Physically Based Shading at Imageworks", SIGGRAPH course 2017.


Share = TypeVar("Share", float, F32)

# Below this alpha, a point light's highlight is narrower than the resolution of directions in float32.
_MIN_ALPHA = 1e-4
_MIN_COSINE = 1e-6

# Nodes of the albedo tables and linear interpolation between them are those of Cycles.
_ALBEDO_NODES = 32
_FRESNEL_NODES = 16
# Facets to average for each node of a table; 512 give about 0.1% error.
_RAYS = 512


def ggx(alpha: float, sine_squared: F32, cos_light: F32, cos_view: F32) -> F32:
    """Reflectance (N,) in 1/sr of mirror facets, without Fresnel: D G / (4 cos cos). Reciprocal.

    sine_squared: (N,) of the angle between normal and half vector. Its cosine would be too close to 1 to resolve narrow
    highlights.
    """
    squared = np.float32(max(alpha, _MIN_ALPHA) ** 2)
    cos_light, cos_view = np.maximum(cos_light, _MIN_COSINE), np.maximum(cos_view, _MIN_COSINE)
    slope = sine_squared + squared * (1 - sine_squared)
    masking = cos_light * np.sqrt(squared + (1 - squared) * cos_view * cos_view)
    masking += cos_view * np.sqrt(squared + (1 - squared) * cos_light * cos_light)
    return squared / (np.float32(2 * np.pi) * slope * slope * masking)


def fresnel_dielectric(cosine: Floats, ior: Floats | float) -> Floats:
    """Fresnel reflectance for unpolarised light at a boundary of relative index `ior`, 1 at total reflection."""
    inside = ior * ior - 1 + cosine * cosine
    g = np.sqrt(np.maximum(inside, 0))
    a = (g - cosine) / np.maximum(g + cosine, 1e-12)
    b = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)
    return np.where(inside > 0, 0.5 * a * a * (1 + b * b), 1)


def reflectance_of_ior(ior: float) -> float:
    """Fresnel reflectance at normal incidence (f0)."""
    ior = max(ior, 1e-5)
    return ((ior - 1) / (ior + 1)) ** 2


def ior_of_reflectance(f0: float) -> float:
    """The index above 1 with reflectance f0 at normal incidence (up to 0.99)."""
    root: float = min(max(f0, 0.0), 0.99) ** 0.5
    return (1 + root) / (1 - root)


def fresnel_average(ior: float) -> float:
    """Mean of :func:`fresnel_dielectric` over a hemisphere of light."""
    cosines = (np.arange(256) + 0.5) / 256
    return float(2 * (cosines * fresnel_dielectric(cosines, ior)).mean())


def albedo(roughness: float, cosines: F64) -> tuple[F64, float]:
    """Directional albedo of mirror facets with single scattering.

    Returns the albedo at view cosines (K,), and its mean over all views.
    """
    single, average, _ = _tables()
    at_roughness = _between(single, roughness)
    return np.interp(cosines, np.linspace(0, 1, _ALBEDO_NODES), at_roughness), float(_between(average, roughness))


def further_reflections(facets: Share, average: float) -> Share:
    """Kulla and Conty's estimate of multiple scattering: share of the light not reflected by single scattering that
    leaves after further reflections, divided by the facets' reflectance.

    facets: mean reflectance of the facets. average: mean albedo of mirror facets.
    """
    return facets * average / (1 - facets * (1 - average))


def fresnel_share(roughness: float, ior: float, cosines: F64) -> F64:
    """(K,) mean Fresnel reflectance over the visible facets, rescaled from f0 to 1 onto 0 to 1."""
    table = _between(_between(_tables()[2], abs(reflectance_of_ior(ior)) ** 0.25), roughness)
    return np.interp(cosines, np.linspace(0, 1, _FRESNEL_NODES), table)


def _between(table: F64, position: float) -> F64:
    # Interpolates the table at a position from 0 to 1 along its first axis.
    place = min(max(position, 0.0), 1.0) * (len(table) - 1)
    below = min(int(place), len(table) - 2)
    return table[below] + (place - below) * (table[below + 1] - table[below])


@lru_cache(maxsize=1)
def _tables() -> tuple[F64, F64, F64]:
    # Albedos of mirror facets (roughness, view) and (roughness,); Fresnel shares (ior, roughness, view), where ior is
    # parametrised by the fourth root of f0.
    nodes = np.linspace(0, 1, _ALBEDO_NODES).clip(1e-4)
    _, weight = _reflected(nodes[:, None, None], nodes[:, None])
    single = weight.mean(axis=-1)
    fine = (np.arange(310) + 0.5) / 310
    average = np.array([2 * (np.interp(fine, nodes, row) * fine).mean() for row in single])

    nodes = np.linspace(0, 1, _FRESNEL_NODES).clip(1e-4)
    cosine, weight = _reflected(nodes[:, None, None], nodes[:, None])
    share = np.empty((_FRESNEL_NODES, _FRESNEL_NODES, _FRESNEL_NODES))
    for k, node in enumerate(nodes.clip(max=0.99)):
        f0 = node**4
        fresnel = (fresnel_dielectric(cosine, ior_of_reflectance(f0)) - f0) / (1 - f0)
        share[k] = (fresnel.clip(0, 1) * (weight > 0)).mean(axis=-1)
    return single, average, share


def _reflected(roughness: F64, cosine: F64) -> tuple[F64, F64]:
    # For facets sampled by visible normals: the cosine at the facet, and the unmasked share of its reflection. Heitz,
    # "Sampling the GGX Distribution of Visible Normals", JCGT 2018, on a golden-ratio lattice over half of the disc;
    # the other half is symmetric. The view is in the plane y = 0.
    alpha = np.maximum(roughness**2, _MIN_ALPHA)
    points = np.arange(_RAYS)
    radius = np.sqrt((points + 0.5) / _RAYS)
    turn = ((points * (np.sqrt(5) - 1) / 2) % 1 - 0.5) * np.pi
    across, up = radius * np.cos(turn), radius * np.sin(turn)
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    length = np.hypot(alpha * sine, cosine)
    x, z = alpha * sine / length, cosine / length
    up = (1 - z) / 2 * np.sqrt(1 - across**2) + (1 + z) / 2 * up
    out = np.sqrt(np.maximum(1 - across**2 - up**2, 0))
    facet = np.stack(np.broadcast_arrays(alpha * (x * out - z * up), alpha * across, np.maximum(z * out + x * up, 0)))
    facet /= np.sqrt((facet**2).sum(axis=0))
    on_facet = facet[0] * sine + facet[2] * cosine
    leaving = 2 * on_facet * facet[2] - cosine
    above = np.maximum(leaving, 1e-6)
    stretch = np.sqrt(1 + alpha**2 * (1 / cosine**2 - 1)), np.sqrt(1 + alpha**2 * (1 / above**2 - 1))
    weight = (1 + stretch[0]) / (stretch[0] + stretch[1])
    return on_facet.clip(0, 1), np.where(leaving > 0, weight, 0)


# --- sheen: light scattered by a layer of fine fibres on the surface, as on cloth and dust ----------------------------
# Zeltner, Burley and Chiang, "Practical Multiple-Scattering Sheen Using Linearly Transformed Cosines", SIGGRAPH 2022
# talks. Cycles uses the authors' tables of the transform; this is MaterialX's closed form, which is fitted to them.


@dataclass(frozen=True)
class Sheen:
    """Sheen of one roughness at K view cosines: a cosine lobe, stretched by `spread`, sheared by `shear` and scaled."""

    albedo: F64
    """(K,) float64. Directional albedo, which scales the lobe, 0 to 1."""
    spread: F64
    """(K,) float64. Stretch of the lobe."""
    shear: F64
    """(K,) float64. Shear of the lobe."""


def sheen(roughness: float, cosines: F64) -> Sheen:
    """The sheen layer of a roughness from 0 to 1, seen at `cosines` (K,)."""
    # The fits are not valid for smaller roughness.
    x, y = cosines, min(max(roughness, 0.01), 1.0)
    width = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    middle = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    floor = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    albedo = np.exp(-0.5 * ((x - middle) / width) ** 2) / (width * np.sqrt(2 * np.pi)) + floor
    spread = (2.58126 * x + 0.813703 * y) * y / (1 + 0.310327 * x * x + 2.60994 * x * y)
    shear = np.sqrt(1 - x) * (y - 1) * y**3 / (0.0000254053 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y)
    return Sheen(albedo.clip(0, 1), spread, shear)


def sheen_lobe(spread: F32, shear: F32, cos_light: F32, cos_view: F32, cos_between: F32) -> F32:
    """Reflectance (N,) in 1/sr of a sheen layer of albedo 1. cos_between: of the angle between light and viewer."""
    sine = np.sqrt(np.maximum(1 - cos_view * cos_view, 1e-12))
    towards_view = (cos_between - cos_light * cos_view) / sine
    length = spread * spread * (1 - cos_light * cos_light)
    length += cos_light * (2 * spread * shear * towards_view + (shear * shear + 1) * cos_light)
    lobe = np.square(spread / np.maximum(length, 1e-6)) / np.float32(np.pi)
    return np.asarray(lobe, np.float32)


COAT_IOR = 1.5
# Steps of tables over the view's cosine. Those of Cycles have 15 and 31 steps, and 465 is a multiple of both.
_STEPS = 465


class PrincipledBsdf(AboveSurface):
    """A principled material, called as a :class:`~mpsnet_core.synthesis.reflectance.Reflectance`.

    Parameters
    ----------
    material : Material
        Its parameters, clamped to Blender's ranges. Paint multiplies the base colour.

    Raises
    ------
    SettingsError
        If a parameter is not finite.
    """

    def __init__(self, material: Material) -> None:
        for field in fields(material):
            value = getattr(material, field.name)
            if not isinstance(value, str) and not np.isfinite(value).all():
                raise SettingsError(f"the material's {field.name} is {value}; give finite numbers")
        self._base = np.asarray(material.base_color, np.float32)
        roughness, coat_roughness = _share(material.roughness), _share(material.coat_roughness)
        self._alpha, self._coat_alpha = roughness**2, coat_roughness**2
        self._metallic, self._coat, self._sheen = map(_share, (material.metallic, material.coat, material.sheen))
        f0 = min(reflectance_of_ior(material.ior) * 2 * max(material.specular, 0.0), 0.99)
        self._ior = ior_of_reflectance(f0) if material.ior >= 1 else 1 / ior_of_reflectance(f0)
        self._specular = f0 > 0 and self._metallic < 1

        # From top to bottom; `left` is the share of light that the layers above transmit, by view.
        cosines = np.linspace(0, 1, _STEPS + 1)
        fibres = sheen(material.sheen_roughness, cosines)
        sheen_scale = self._sheen * fibres.albedo
        left = 1 - sheen_scale
        coat, coat_albedo = _dielectric(coat_roughness, COAT_IOR, cosines)
        coat_scale = left * self._coat * coat
        left = left * (1 - self._coat * coat_albedo)
        metal_scale = left * self._metallic
        left = left * (1 - self._metallic)
        specular, specular_albedo = _dielectric(roughness, self._ior, cosines)
        specular_scale = left * specular
        diffuse_scale = left * (1 - specular_albedo) / np.pi
        single, self._average = albedo(roughness, cosines)
        columns = (
            *(diffuse_scale, specular_scale, metal_scale, 1 / single - 1),
            *(coat_scale, sheen_scale, fibres.spread, fibres.shear),
        )
        self._by_view = np.stack(columns, axis=-1).astype(np.float32)

    def _evaluate(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None) -> Floats:
        base = np.clip(self._base if paint is None else self._base * paint, 0, 1)
        cos_light, cos_view = np.minimum(dot(normals, lights), 1), np.minimum(dot(normals, views), 1)
        position = cos_view * _STEPS
        step = np.minimum(position.astype(np.intp), _STEPS - 1)
        rows = np.take(self._by_view, step, axis=0)
        rows += (position - step)[:, None] * (np.take(self._by_view, step + 1, axis=0) - rows)
        diffuse, specular, metal, missing, coat, sheen, spread, shear = rows.T
        result: F32 = diffuse[:, None] * base

        towards = lights + views
        length = np.maximum(np.sqrt(dot(towards, towards)), np.float32(1e-6))
        off_normal = normals - towards / length[:, None]
        half_sine_squared = np.minimum(dot(off_normal, off_normal) / 4, 1)
        sine_squared = 4 * half_sine_squared * (1 - half_sine_squared)
        cos_difference = np.minimum(length / 2, 1)
        gloss = np.zeros_like(cos_light)
        if self._specular or self._metallic:
            facets = ggx(self._alpha, sine_squared, cos_light, cos_view)
        if self._specular:
            gloss += specular * facets * fresnel_dielectric(cos_difference, self._ior)
        if self._coat:
            coat_facets = ggx(self._coat_alpha, sine_squared, cos_light, cos_view)
            gloss += coat * coat_facets * fresnel_dielectric(cos_difference, COAT_IOR)
        if self._sheen:
            cos_between = length * length * np.float32(0.5) - 1
            gloss += sheen * sheen_lobe(spread, shear, cos_light, cos_view, cos_between)
        result += gloss[:, None]
        if self._metallic:
            # Schlick's Fresnel, whose hemispherical mean is f0 + (1 - f0) / 21.
            grazing = ((1 - cos_difference) ** 5)[:, None]
            energy = 1 + missing[:, None] * further_reflections(base + (1 - base) / 21, self._average)
            result += (metal * facets)[:, None] * (base + (1 - base) * grazing) * energy
        return result


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def _dielectric(roughness: float, ior: float, cosines: F64) -> tuple[F64, F64]:
    # Factor of a dielectric's lobe for multiple scattering, and its albedo, both (K,). The albedo is estimated as in
    # Cycles: the mean Fresnel reflectance times the albedo of mirror facets.
    single, average = albedo(roughness, cosines)
    further = further_reflections(fresnel_average(ior), average)
    f0 = reflectance_of_ior(ior)
    share = f0 + (1 - f0) * fresnel_share(roughness, ior, cosines)
    return 1 + (1 / single - 1) * further, share * (single + (1 - single) * further)
