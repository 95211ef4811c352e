"""Where a model errs: the pixels of a sample by the lights that reach them, curvature, open sky, slant and material."""

from collections.abc import Callable, Sequence

import numpy as np

from mpsnet_core.arrays.types import Bools, Floats
from mpsnet_core.io.text_table import text_table
from mpsnet_core.learning.evaluation.measure import Row
from mpsnet_core.relief.curvature import curvature
from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.occlusion import ambient_occlusion
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material

# Pixels around each one whose curvature is averaged: hollows, not grain.
RADIUS = 8


def _by_lights(sample: Sample) -> dict[str, Bools]:
    count = (sample.lit >= 0.5).sum(axis=0)
    return {"three": count == 3, "two": count == 2, "one": count == 1, "none": count == 0}


def _by_curvature(sample: Sample) -> dict[str, Bools]:
    """Hollow and convex: bent at least half as much as a sphere as large as the object."""
    bent = curvature(_normals(sample), sample.recipe.camera, sample.depth, radius=RADIUS)
    return _ranges(bent, {"hollow": -1.0, "flat": 1.0, "convex": np.inf})


def _by_sky(sample: Sample) -> dict[str, Bools]:
    """By the part of the hemisphere over a pixel that the object leaves open."""
    heights = HeightMap(-sample.depth, sample.mask, sample.recipe.camera)
    return _ranges(ambient_occlusion(heights, _normals(sample)), {"below half": 0.5, "half": 0.8, "open": np.inf})


def _by_slant(sample: Sample) -> dict[str, Bools]:
    slant = np.degrees(np.arccos(np.clip(sample.normals[..., 2], -1, 1)))
    return _ranges(slant, {"to 30°": 30.0, "to 60°": 60.0, "above": np.inf})


def _by_material(sample: Sample) -> dict[str, Bools]:
    kinds = np.array([*map(_kind, sample.recipe.materials), "none"])[sample.material]  # -1, the last, outside
    return {kind: kinds == kind for kind in ("matt", "glossy", "metal", "measured")}


def _kind(material: Material) -> str:
    if material.kind != "principled":
        return "measured"
    if material.metallic > 0.5:
        return "metal"
    return "glossy" if material.roughness < 0.4 or material.coat > 0.25 else "matt"


PIXEL_KINDS: dict[str, Callable[[Sample], dict[str, Bools]]] = {
    "lights": _by_lights,
    "curvature": _by_curvature,
    "sky": _by_sky,
    "slant": _by_slant,
    "material": _by_material,
}


def regions_by_kind(sample: Sample, kinds: Sequence[str]) -> dict[str, Bools]:
    """The parts of a sample's image (H, W) as regions "lights: two", of these of :data:`PIXEL_KINDS`."""
    return {f"{kind}: {name}": part for kind in kinds for name, part in PIXEL_KINDS[kind](sample).items()}


def share(region: str) -> str:
    """The metric of a row that says which fraction of its pixels lies in a region."""
    return f"{region}_share"


def table_by_kind(rows: Sequence[Row], kind: str) -> str:
    """For each model and part: mean error, and shares of the pixels and of the whole error. Samples count alike."""
    models: dict[str, list[Row]] = {}
    for row in rows:
        models.setdefault(str(row.labels["model"]), []).append(row)
    lines = []
    for model, own in models.items():
        whole = sum(row.mae_deg for row in own)
        parts = dict.fromkeys(name for row in own for name in row.further if name.startswith(f"{kind}: "))
        for part in parts:
            region = part.removesuffix("_share")
            pixels = np.array([row.further.get(part, 0.0) for row in own])
            summed = pixels @ [row.errors.get(f"{region}_deg", 0.0) for row in own]
            cells = f"{summed / max(pixels.sum(), 1e-9):.2f}", f"{pixels.mean():.1%}", f"{summed / whole:.1%}"
            lines.append([model, region.removeprefix(f"{kind}: "), *cells])
    return text_table(["model", kind, "error", "of pixels", "of error"], lines, 2)


def _normals(sample: Sample) -> NormalMap:
    return NormalMap(sample.normals, sample.mask)


def _ranges(values: Floats, ends: dict[str, float]) -> dict[str, Bools]:
    """The pixels whose values lie between one end and the next."""
    found, low = {}, -np.inf
    for name, high in ends.items():
        found[name], low = (values >= low) & (values < high), high
    return found
