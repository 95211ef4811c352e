"""GGX: the microfacet reflection of Cycles' Principled BSDF, and its directional albedo.

Roughness is the perceptual one; alpha of the distribution is its square.

Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007; Heitz, "Understanding the
Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT 2014. Multiple scattering: Kulla and Conty, "Revisiting
Physically Based Shading at Imageworks", SIGGRAPH course 2017.
"""

from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Share = TypeVar("Share", float, NDArray[np.float32])

# Below this alpha, a point light's highlight is narrower than the resolution of directions in float32.
_MIN_ALPHA = 1e-4
_MIN_COSINE = 1e-6

# Nodes of the albedo tables and linear interpolation between them are those of Cycles.
_ALBEDO_NODES = 32
_FRESNEL_NODES = 16
# Facets to average for each node of a table; 512 give about 0.1% error.
_RAYS = 512


def ggx(
    alpha: float, sine_squared: NDArray[np.float32], cos_light: NDArray[np.float32], cos_view: NDArray[np.float32]
) -> NDArray[np.float32]:
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


def fresnel_dielectric(
    cosine: NDArray[np.floating[Any]], ior: NDArray[np.floating[Any]] | float
) -> NDArray[np.floating[Any]]:
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


def albedo(roughness: float, cosines: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
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


def fresnel_share(roughness: float, ior: float, cosines: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) mean Fresnel reflectance over the visible facets, rescaled from f0 to 1 onto 0 to 1."""
    table = _between(_between(_tables()[2], abs(reflectance_of_ior(ior)) ** 0.25), roughness)
    return np.interp(cosines, np.linspace(0, 1, _FRESNEL_NODES), table)


def _between(table: NDArray[np.float64], position: float) -> NDArray[np.float64]:
    # Interpolates the table at a position from 0 to 1 along its first axis.
    place = min(max(position, 0.0), 1.0) * (len(table) - 1)
    below = min(int(place), len(table) - 2)
    return table[below] + (place - below) * (table[below + 1] - table[below])


@lru_cache(maxsize=1)
def _tables() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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


def _reflected(
    roughness: NDArray[np.float64], cosine: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
