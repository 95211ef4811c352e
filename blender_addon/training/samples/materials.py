"""A recipe's surface as one Blender material: principled materials in a pattern, paint, dirt and bump."""

from itertools import pairwise
from typing import Any

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.scene_description import Bump, Dirt, Material, Paint, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.pattern import DARKEST_PAINT, DIRT_EDGE, DIRT_OCTAVES, NOISE, PAINT_OCTAVES

from ...appearance.nodes import new_material
from .nodes import Graph, Value

PART = "part"  # mesh attribute: the part of each face
WEIGHTS_PER_PASS = 3
# The logistic function of 1.702 x approximates the normal distribution function to 1%.
_LOGISTIC = 1.702


def weight_passes(recipe: SceneDescription) -> list[str]:
    """Names of the render passes (AOVs) with the materials' weights, three per pass as R, G and B."""
    return [f"weights{first}" for first in range(0, len(recipe.materials), WEIGHTS_PER_PASS)]


def build_material(recipe: SceneDescription) -> Any:
    """A new material after the recipe, in object space.

    Raises InputError if one of the recipe's materials is not principled: Cycles does not support measured ones.
    """
    for one in recipe.materials:
        if one.kind != "principled":
            raise InputError(
                f'Cycles cannot render the measured material "{one.source}"; synthesise this sample or leave out merl'
            )
    material = new_material("MPS Sample")
    graph = Graph(material.node_tree)
    points = graph.node("ShaderNodeTexCoord").outputs["Object"]
    weights = _weights(graph, points, recipe.pattern, len(recipe.materials))
    normal = _bumped(graph, points, recipe.bump)
    factors = _paint(graph, points, recipe.paint)
    surface = _mixed(graph, [_principled(graph, one, factors, normal) for one in recipe.materials], weights)
    surface = _dirty(graph, points, recipe.dirt, normal, surface)
    graph.node("ShaderNodeOutputMaterial", {"Surface": surface})
    for number, name in enumerate(weight_passes(recipe)):
        three = weights[number * WEIGHTS_PER_PASS :][:WEIGHTS_PER_PASS]
        graph.node("ShaderNodeOutputAOV", {"Color": graph.join(three)}, aov_name=name)
    return material


def _principled(graph: Graph, material: Material, factors: Value | None, normal: Value | None) -> Any:
    color = material.base_color
    inputs: dict[Any, Value] = {
        "Base Color": color if factors is None else graph.vector("MULTIPLY", factors, color),
        "Roughness": material.roughness,
        "Metallic": material.metallic,
        "Specular IOR Level": material.specular,
        "IOR": material.ior,
        "Sheen Weight": material.sheen,
        "Sheen Roughness": material.sheen_roughness,
        "Coat Weight": material.coat,
        "Coat Roughness": material.coat_roughness,
        "Subsurface Weight": material.subsurface,
        "Subsurface Radius": (1.0, 1.0, 1.0),
        "Subsurface Scale": material.subsurface_radius,
    }
    if normal is not None:
        inputs |= {"Normal": normal, "Coat Normal": normal}
    return graph.node("ShaderNodeBsdfPrincipled", inputs).outputs[0]


def _mixed(graph: Graph, surfaces: list[Any], weights: list[Value]) -> Any:
    """A mix of the surfaces by their weights, which sum to 1."""
    mixed, total = surfaces[0], weights[0]
    for surface, weight in zip(surfaces[1:], weights[1:], strict=True):
        total = graph.math("ADD", total, weight)
        share = graph.math("DIVIDE", weight, graph.math("MAXIMUM", total, 1e-6))
        mixed = graph.node("ShaderNodeMixShader", {0: share, 1: mixed, 2: surface}).outputs[0]
    return mixed


def _dirty(graph: Graph, points: Value, dirt: Dirt, normal: Value | None, surface: Any) -> Any:
    if not dirt.amount:
        return surface
    matt = graph.node("ShaderNodeBsdfDiffuse", {"Color": dirt.color} | ({} if normal is None else {"Normal": normal}))
    level = graph.split(graph.noise(points, dirt.scale, dirt.seed, DIRT_OCTAVES))[0]
    edge = NOISE.inv_cdf(1 - min(dirt.amount, 0.999))
    settings = {0: level, 1: edge - DIRT_EDGE, 2: edge + DIRT_EDGE}
    share = graph.node("ShaderNodeMapRange", settings, interpolation_type="SMOOTHSTEP").outputs[0]
    return graph.node("ShaderNodeMixShader", {0: share, 1: surface, 2: matt.outputs[0]}).outputs[0]


def _paint(graph: Graph, points: Value, paint: Paint) -> Value | None:
    """The factor on base colours, or None for none."""
    if not paint.amount:
        return None
    own = graph.noise(points, paint.scale, paint.seed, PAINT_OCTAVES)
    common = graph.join([graph.split(own)[0]] * 3)
    blend = graph.vector("MULTIPLY_ADD", graph.vector("SUBTRACT", own, common), (paint.hue,) * 3, common)
    factors = graph.vector("MULTIPLY_ADD", blend, (paint.amount,) * 3, (1.0, 1.0, 1.0))
    return graph.vector("MAXIMUM", factors, (DARKEST_PAINT,) * 3)


def _bumped(graph: Graph, points: Value, bump: Bump) -> Value | None:
    """The shading normal under the bump, or None for the mesh's own."""
    if not bump.height:
        return None
    height = graph.split(graph.noise(points, bump.scale, bump.seed))[0]
    settings = {"Height": height, "Distance": bump.height, "Strength": 1.0}
    return graph.node("ShaderNodeBump", settings).outputs["Normal"]


def _weights(graph: Graph, points: Value, pattern: Pattern, count: int) -> list[Value]:
    """The weight of each material by position in object space."""
    if count == 1:
        return [1.0]
    if pattern.warp and pattern.kind != "parts":
        bend = graph.noise(points, pattern.scale / 2, pattern.seed ^ 1)
        points = graph.vector("MULTIPLY_ADD", bend, (2 * pattern.warp / pattern.scale,) * 3, points)
    if pattern.kind == "parts":
        part = graph.node("ShaderNodeAttribute", attribute_name=PART).outputs[2]  # "Fac", in 5.0 "Factor"
        return _picked(graph, graph.math("MODULO", graph.math("ADD", part, 0.5), count), count)
    if pattern.kind == "voronoi":
        return _cells(graph, points, pattern, count)
    if pattern.kind == "noise":
        value = graph.split(graph.noise(points, pattern.scale, pattern.seed))[0]
        # The normal distribution function of the value gives bands of equal area.
        slope = -_LOGISTIC / NOISE.stdev
        share = graph.math(
            "DIVIDE", 1.0, graph.math("ADD", graph.math("EXPONENT", graph.math("MULTIPLY", value, slope)), 1.0)
        )
        rises = [_rise(graph, graph.math("MULTIPLY", share, count), k, pattern.softness) for k in range(1, count)]
        return _between(graph, rises)
    along = graph.vector("DOT_PRODUCT", points, pattern.direction)
    turn = graph.math("FRACT", graph.math("MULTIPLY_ADD", along, pattern.scale / count, -0.5 / count))
    level = graph.math("MULTIPLY", turn, count)
    # Shifted by half a stripe: no transition lies where the period wraps around.
    rises = [_rise(graph, level, k - 0.5, pattern.softness) for k in range(1, count + 1)]
    weights = _between(graph, rises)
    last = weights.pop()
    return [graph.math("ADD", weights[0], last), *weights[1:]]


def _rise(graph: Graph, level: Value, edge: float, softness: float) -> Any:
    """A linear ramp from 0 to 1 where the level passes the edge, of width `softness`."""
    if not softness:
        return graph.math("GREATER_THAN", level, edge)
    return graph.math("MULTIPLY_ADD", level, 1 / softness, 0.5 - edge / softness, clamp=True)


def _between(graph: Graph, rises: list[Any]) -> list[Any]:
    """Weights of the bands before, between and after successive ramps."""
    middle = [graph.math("SUBTRACT", low, high) for low, high in pairwise(rises)]
    return [graph.math("SUBTRACT", 1.0, rises[0]), *middle, rises[-1]]


def _picked(graph: Graph, level: Value, count: int) -> list[Any]:
    """1 for the material whose index is the integer part of the level, 0 for the others."""
    return _between(graph, [_rise(graph, level, k, 0) for k in range(1, count)])


def _cells(graph: Graph, points: Value, pattern: Pattern, count: int) -> list[Any]:
    """One material per cell, chosen by the cell's random colour, blended with the neighbour's near borders.

    Blender 5.0 changed the random cells of 4.5. All other patterns are the same in all versions.
    """

    def own(feature: str) -> list[Any]:
        color = graph.voronoi(points, pattern.scale, pattern.seed, feature).outputs["Color"]
        return _picked(graph, graph.math("MULTIPLY", graph.split(color)[0], count), count)

    nearest = own("F1")
    if not pattern.softness:
        return nearest
    border = graph.voronoi(points, pattern.scale, pattern.seed, "DISTANCE_TO_EDGE").outputs["Distance"]
    # Half of each at the border, only the own material from half the softness on.
    share = graph.math("MULTIPLY_ADD", border, -1 / pattern.softness, 0.5, clamp=True)
    return [
        graph.math("MULTIPLY_ADD", graph.math("SUBTRACT", other, one), share, one)
        for one, other in zip(nearest, own("F2"), strict=True)
    ]
