"""Assembly: solids flow into one surface, finished surfaces are set into it, and a texture goes over them."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.noise import gradient_noise
from mpsnet_core.synthesis.shapes.draws import between, chance, direction, new_seed, picked
from mpsnet_core.synthesis.shapes.isosurface import bounds, isosurface
from mpsnet_core.synthesis.shapes.shape import Shape, joined
from mpsnet_core.synthesis.shapes.solids import Solid
from mpsnet_core.synthesis.shapes.surfaces import bent, displaced

Array = NDArray[np.float64]
Piece = Solid | Shape

# Numbers of the parts.
BODY, HEAD, ARMS, LEGS, FEATURES, DRESS, LOAD, BASE = range(8)
# Surfaces with longer edges than this cannot show a texture.
COARSE = 0.13


def softness(rng: np.random.Generator) -> float:
    """How wide joints flow into each other, as a share of the limbs' thickness: pressed clay to melted wax."""
    return picked(rng, (0.12, 0.35, 0.8, 1.4), (2, 3, 3, 1))


def assembled(pieces: Sequence[Piece], cells: int, rng: np.random.Generator) -> Shape:
    """All solids as one isosurface, `cells` grid cells along its longest side, with the surfaces set into it.

    A texture may go over all that is meshed finely enough to show it, and the whole may be bent.
    """
    solids = [piece for piece in pieces if isinstance(piece, Solid)]
    shapes = [piece for piece in pieces if isinstance(piece, Shape)]
    if solids:
        low, high = bounds(solids)
        shapes.insert(0, isosurface(solids, float((high - low).max()) / cells))
    texture = _texture(rng)
    if texture is not None:
        shapes = [displaced(shape, texture) if _longest_edge(shape) < COARSE else shape for shape in shapes]
    shape = joined(shapes)
    if chance(rng, 0.35):
        shape = bent(shape, _bend(rng))
    if chance(rng, 0.2):  # lumps that move both sides of what is thin alike
        scale, push, seed = between(rng, 2, 5), between(rng, 0.05, 0.15), new_seed(rng)
        shape = bent(shape, lambda points: points + push / scale * _vectors(points * scale, seed))
    return shape


def _longest_edge(shape: Shape) -> float:
    corners = shape.vertices[shape.triangles]
    return float(np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max()))


def _texture(rng: np.random.Generator) -> Callable[[Array], Array] | None:
    """The heights of a material's surface, all over or here and there; none where it is plain."""
    name = picked(rng, ("plain", "hammered", "grainy", "wrinkled", "folded"), (0.4, 0.14, 0.12, 0.18, 0.16))
    if name == "plain":
        return None
    scale, amount = {
        "hammered": (between(rng, 7, 14), between(rng, 0.006, 0.015)),
        "grainy": (between(rng, 18, 30), between(rng, 0.002, 0.005)),
        "wrinkled": (between(rng, 5, 10), between(rng, 0.02, 0.04)),
        "folded": (between(rng, 4, 9), between(rng, 0.03, 0.06)),
    }[name]
    stretch = scale * np.array([between(rng, 0.2, 1) if name == "wrinkled" else 1.0 for _ in range(3)])
    if name == "folded":  # folds that hang
        stretch[2] *= between(rng, 0.1, 0.3)
    seed, patchy = new_seed(rng), chance(rng, 0.5)

    def height(points: Array) -> Array:
        field = gradient_noise(points * stretch, seed).astype(np.float64)
        if name in ("wrinkled", "folded"):  # round between sharp valleys
            field = np.sqrt(field**2 + 0.01) - 0.3
        if patchy:
            field *= np.clip(0.5 + 2.5 * gradient_noise(points * 1.5, seed + 1), 0, 1)
        return amount * field

    return height


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
