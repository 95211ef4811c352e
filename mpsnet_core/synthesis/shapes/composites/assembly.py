"""Assembly: solids flow into one surface, finished surfaces are set into it, and a texture goes over the whole."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.noise import gradient_noise
from mpsnet_core.synthesis.shapes.draws import between, chance, direction, new_seed, picked
from mpsnet_core.synthesis.shapes.isosurface import isosurface
from mpsnet_core.synthesis.shapes.shape import Shape, joined
from mpsnet_core.synthesis.shapes.solids import Solid
from mpsnet_core.synthesis.shapes.surfaces import bent, displaced

Array = NDArray[np.float64]
Piece = Solid | Shape

# Numbers of the parts.
BODY, HEAD, ARMS, LEGS, FEATURES, DRESS, LOAD, BASE = range(8)


def assembled(pieces: Sequence[Piece], cells: int) -> Shape:
    """All solids as one isosurface, `cells` grid cells along its longest side, with the surfaces set into it."""
    solids = [piece for piece in pieces if isinstance(piece, Solid)]
    surfaces = [piece for piece in pieces if isinstance(piece, Shape)]
    if not solids:
        return joined(surfaces)
    extents = np.array([np.abs(solid.axes.T) @ solid.half for solid in solids if not solid.carve])
    centres = np.array([solid.centre for solid in solids if not solid.carve])
    size = ((centres + extents).max(axis=0) - (centres - extents).min(axis=0)).max()
    return joined([isosurface(solids, size / cells), *surfaces])


def textured(shape: Shape, rng: np.random.Generator) -> Shape:
    """The shape bent or twisted now and then, and given the surface of what it may be made of."""
    if chance(rng, 0.35):
        shape = bent(shape, _bend(rng))
    name = picked(rng, ("plain", "lumpy", "hammered", "grainy", "wrinkled"), (0.4, 0.16, 0.16, 0.12, 0.16))
    if name == "plain":
        return shape
    seed = new_seed(rng)
    if name == "lumpy":  # moves both sides of what is thin alike
        scale, push = between(rng, 2, 5), between(rng, 0.05, 0.15)
        return bent(shape, lambda points: points + push / scale * _vectors(points * scale, seed))
    scale, amount = {
        "hammered": (between(rng, 7, 14), between(rng, 0.006, 0.015)),
        "grainy": (between(rng, 18, 30), between(rng, 0.002, 0.005)),
        "wrinkled": (between(rng, 5, 10), between(rng, 0.006, 0.015)),
    }[name]
    if name != "wrinkled":
        return displaced(shape, lambda points: amount * gradient_noise(points * scale, seed))
    stretch = scale * np.array([between(rng, 0.2, 1) for _ in range(3)])
    # Soft between sharp valleys.
    return displaced(shape, lambda p: amount * (np.sqrt(gradient_noise(p * stretch, seed) ** 2 + 0.01) - 0.3))


def _bend(rng: np.random.Generator) -> Callable[[Array], Array]:
    """A smooth map of space: a twist about the upright axis, a lean to one side, and soft swells."""
    twist, lean = between(rng, -35, 35), between(rng, -0.18, 0.18)
    side = direction(rng) * (1, 1, 0)
    seed, swell = new_seed(rng), between(rng, 0, 0.08)

    def bend(points: Array) -> Array:
        angles = np.radians(twist) * points[:, 2]
        cos, sin = np.cos(angles), np.sin(angles)
        x, y = points[:, 0], points[:, 1]
        moved = np.stack([cos * x - sin * y, sin * x + cos * y, points[:, 2]], axis=1)
        return moved + (lean * points[:, 2] ** 2)[:, None] * side + swell * _vectors(points * 1.2, seed)

    return bend


def _vectors(points: Array, seed: int) -> Array:
    return np.stack([gradient_noise(points, seed + k) for k in range(3)], axis=1).astype(np.float64)
