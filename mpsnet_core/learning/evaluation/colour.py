"""Test of colour: smooth shapes in many colours. Measures errors at colour edges, and the effect of colour alone."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_measures
from mpsnet_core.learning.evaluation.measure import Case, Result, Row, white_choices
from mpsnet_core.learning.evaluation.operations import EvaluateColour
from mpsnet_core.learning.evaluation.scenes import built_blob, held_out_blob, ideal_photograph, published_view
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Colour, Material, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.pattern import material_weights
from mpsnet_core.synthesis.shading.surface_points import Surface
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import Shape

ROUGHNESS = 0.6
WHITE: Colour = (0.8, 0.8, 0.8)
RED, GREEN, BLUE, YELLOW, DARK = (
    (0.6, 0.06, 0.04),
    (0.06, 0.36, 0.08),
    (0.05, 0.09, 0.5),
    (0.75, 0.55, 0.05),
    (0.06, 0.06, 0.06),
)
MANY = (RED, GREEN, BLUE, YELLOW, DARK, WHITE)

# Colours of the surface and their pattern. White comes first: the others are compared with it.
COLOURINGS: dict[str, tuple[tuple[Colour, ...], Pattern]] = {
    "white": ((WHITE,), Pattern()),
    "red": ((RED,), Pattern()),
    "hard cells": (MANY, Pattern("voronoi", scale=3.0, seed=1)),
    "hard stripes": ((RED, WHITE, BLUE, YELLOW), Pattern("stripes", scale=4.0, direction=(0.6, 0.8, 0.0), warp=0.3)),
    "soft bands": (MANY, Pattern("noise", scale=1.0, softness=0.5, seed=2)),
    "soft grey": ((WHITE, DARK), Pattern("noise", scale=2.5, softness=0.6, seed=3)),
}
# A colour edge is where neighbouring pixels differ by more than this share of the brighter one.
CHANGE = 0.02
NEAR = 3  # pixels


class ColourChanges(Evaluation):
    """Held-out blobs in one and in many colours of equal roughness, under direct light."""

    title = "A blob, many colours"

    def __init__(self, options: EvaluateColour) -> None:
        self._white: dict[tuple[str, str, int, str], F32] = {}
        self.cases = [
            partial(painted_blob, name, protocol, options.size, white=beside, blob=blob)
            for blob in range(options.blobs)
            for name in COLOURINGS
            for protocol in options.protocol
            for beside in white_choices(options.white)
        ]

    def rows(self, results: Sequence[Result]) -> list[Row]:
        """Rows with an additional "moved_deg": mean angle between this estimate and that of the same shape in white."""
        rows = []
        for result, row in zip(results, super().rows(results), strict=True):
            kind = row.labels["object"], row.labels["protocol"], row.labels["photos"], result.model
            white = self._white.setdefault(kind, result.estimate.vectors)
            moved = angular_error(result.estimate.vectors, white)[result.case.scored].mean()
            further = {"moved_deg": round(float(moved), 4)} if row.labels["colouring"] != "white" else {}
            rows.append(replace(row, further=further))
        return rows

    def table(self, rows: Sequence[Row]) -> str:
        """A line per protocol, model and measure, a column per colouring."""
        measures = {
            "error": "mae_deg",
            "near edges": "near_edges_deg",
            "far from edges": "far_from_edges_deg",
            "moved by colour": "moved_deg",
        }
        return table_of_measures(rows, ("protocol", "model"), measures, "colouring")

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """Definitions of the measures."""
        return [
            f"near edges: within {NEAR} pixels of neighbouring pixels whose surface colours, by the recipe, "
            f"differ by more than {CHANGE:.0%} of the brighter",
            "moved by colour: mean angle between the estimates of the same shape in these colours and in white",
        ]


def painted_blob(name: str, protocol: str, size: int, *, white: bool, blob: int = 0) -> Case:
    """A blob in one of :data:`COLOURINGS`. white: whether it has a white photo. blob: its number."""
    colours, pattern = COLOURINGS[name]
    materials = tuple(Material(base_color=colour, roughness=ROUGHNESS) for colour in colours)
    recipe = published_view(held_out_blob(blob), materials, size, pattern=pattern)
    sample = synthesise(recipe, built_blob(blob), [load_reflectance(material) for material in materials])
    near = near_colour_edges(surface_colours(recipe, built_blob(blob)))
    labels = {"object": f"blob {blob + 1}", "colouring": name, "protocol": protocol, "photos": 1 + white}
    photo = ideal_photograph(sample, protocol, white=white)
    return Case(labels, photo, sample.normals, {"near_edges": near, "far_from_edges": ~near})


def surface_colours(recipe: SceneDescription, shape: Shape) -> F32:
    """(H, W, 3) base colour of the surface at each pixel's centre, from the recipe; NaN outside the object.

    recipe: with principled materials, without paint or dirt.
    """
    pixels, _, points = Surface(recipe, shape).seen(recipe.camera)
    weights = material_weights(recipe.pattern, len(recipe.materials), points.place, points.part)
    colours = np.full((recipe.camera.height * recipe.camera.width, 3), np.nan, np.float32)
    colours[pixels] = weights @ np.array([material.base_color for material in recipe.materials], np.float32)
    return colours.reshape(recipe.camera.height, recipe.camera.width, 3)


def near_colour_edges(colours: F32) -> Bools:
    """(H, W) whether a pixel is within :data:`NEAR` pixels of a colour edge. NaN makes no edge."""
    height, width = colours.shape[:2]
    edge = np.zeros((height, width), bool)
    for axis in (0, 1):
        first, second = colours.swapaxes(0, axis)[:-1], colours.swapaxes(0, axis)[1:]
        # Comparisons with NaN are false.
        changed = np.abs(first - second).max(axis=-1) > CHANGE * np.maximum(first, second).max(axis=-1)
        view = edge.swapaxes(0, axis)
        view[:-1] |= changed
        view[1:] |= changed
    padded = np.pad(edge, NEAR)
    near = np.zeros_like(edge)
    for down, right in np.ndindex(2 * NEAR + 1, 2 * NEAR + 1):
        if (down - NEAR) ** 2 + (right - NEAR) ** 2 <= NEAR**2:
            near |= padded[down : down + height, right : right + width]
    return near
