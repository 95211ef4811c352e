"""Shader nodes written as formulas, whose values are sockets or plain numbers."""

from typing import Any

from numpy.random import PCG64, Generator

from mpsnet_core.synthesis.shading.pattern import NOISE

Value = Any  # a socket, a scalar, or three components

# Standard deviation of one octave of Blender's noise, from 0 to 1 around 0.5 (measured in Blender 4.5).
_DEVIATION = 0.133


class Graph:
    """A node tree that is being built."""

    def __init__(self, tree: Any) -> None:
        self.tree = tree
        tree.nodes.clear()

    def node(self, kind: str, inputs: dict[Any, Value] | None = None, **settings: Any) -> Any:
        """Add a node. inputs: by name or index; sockets are linked, numbers become default values."""
        node = self.tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in (inputs or {}).items():
            self._give(node.inputs[name], value)
        return node

    def _give(self, socket: Any, value: Value) -> None:
        if hasattr(value, "is_linked"):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple):
            socket.default_value = value if len(socket.default_value) == len(value) else (*value, 1.0)
        else:
            socket.default_value = value

    def math(self, operation: str, *values: Value, clamp: bool = False) -> Any:
        """A scalar from scalars, by an operation of the Math node."""
        return self.node("ShaderNodeMath", dict(enumerate(values)), operation=operation, use_clamp=clamp).outputs[0]

    def vector(self, operation: str, *values: Value) -> Any:
        """A vector (a scalar for DOT_PRODUCT) from vectors, by an operation of the Vector Math node."""
        node = self.node("ShaderNodeVectorMath", dict(enumerate(values)), operation=operation)
        return node.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    def split(self, vector: Value) -> list[Any]:
        """The three components of a vector or colour."""
        return list(self.node("ShaderNodeSeparateXYZ", {0: vector}).outputs)

    def join(self, numbers: list[Value]) -> Any:
        """A vector from three components."""
        return self.node("ShaderNodeCombineXYZ", dict(enumerate(numbers))).outputs[0]

    def noise(self, points: Value, scale: float, seed: int, octaves: int = 1) -> Any:
        """Three independent noise fields as one vector, with the amplitude of :mod:`mpsnet_core.synthesis.noise`."""
        settings = {"Vector": self._places(points, scale, seed), "Scale": 1.0, "Detail": octaves - 1.0}
        noise = self.node("ShaderNodeTexNoise", settings, noise_dimensions="3D")
        # Blender divides by the sum of the octaves' amplitudes 1, 1/2, 1/4 ...
        deviation = _DEVIATION * sum(0.25**n for n in range(octaves)) ** 0.5 / sum(0.5**n for n in range(octaves))
        gain = NOISE.stdev / deviation
        return self.vector("MULTIPLY_ADD", noise.outputs["Color"], (gain,) * 3, (-0.5 * gain,) * 3)

    def voronoi(self, points: Value, scale: float, seed: int, feature: str) -> Any:
        """A Voronoi node with cells of width 1 / scale. The meaning of its outputs depends on the feature."""
        settings = {"Vector": self._places(points, scale, seed), "Scale": 1.0}
        return self.node("ShaderNodeTexVoronoi", settings, voronoi_dimensions="3D", feature=feature)

    def _places(self, points: Value, scale: float, seed: int) -> Any:
        # Blender's noise has no seed; an offset serves as one.
        return self.vector("MULTIPLY_ADD", points, (scale,) * 3, tuple(Generator(PCG64(seed)).random(3) * 100))
