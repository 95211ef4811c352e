"""The reflectance of Blender's Principled BSDF, with the same parameters.

The layers are those of Cycles since Blender 4.0, from top to bottom: sheen, coat, then metal mixed with a dielectric
(specular over diffuse). A layer attenuates those below by its albedo, which depends on the view only. So individual
lobes are reciprocal, but their sum is not. Multiple scattering between facets is included ("Multiscatter GGX").

Differences from Cycles: subsurface scattering is diffuse reflection at the point of entry; sheen is a fit to the tables
of Cycles; base colour times paint is clamped to 1; there is no transmission, anisotropy or tint.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.errors import SettingsError
from mpsnet_core.synthesis.reflectance.ggx import (
    albedo,
    fresnel_average,
    fresnel_dielectric,
    fresnel_share,
    further_reflections,
    ggx,
    ior_of_reflectance,
    reflectance_of_ior,
)
from mpsnet_core.synthesis.reflectance.hemisphere import AboveSurface, Floats
from mpsnet_core.synthesis.reflectance.sheen import sheen, sheen_lobe
from mpsnet_core.synthesis.scene_description import Material

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
        result: NDArray[np.float32] = diffuse[:, None] * base

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


def _dielectric(
    roughness: float, ior: float, cosines: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Factor of a dielectric's lobe for multiple scattering, and its albedo, both (K,). The albedo is estimated as in
    # Cycles: the mean Fresnel reflectance times the albedo of mirror facets.
    single, average = albedo(roughness, cosines)
    further = further_reflections(fresnel_average(ior), average)
    f0 = reflectance_of_ior(ior)
    share = f0 + (1 - f0) * fresnel_share(roughness, ior, cosines)
    return 1 + (1 / single - 1) * further, share * (single + (1 - single) * further)
