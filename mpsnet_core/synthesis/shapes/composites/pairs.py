"""Pairs: figures and beasts close together, with loads between them."""

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.shapes.composites.assembly import BASE, Piece
from mpsnet_core.synthesis.shapes.composites.beasts import bird, quadruped
from mpsnet_core.synthesis.shapes.composites.figures import biped
from mpsnet_core.synthesis.shapes.composites.things import thing
from mpsnet_core.synthesis.shapes.draws import between, chance, picked
from mpsnet_core.synthesis.shapes.shape import Shape, placed, turn_about
from mpsnet_core.synthesis.shapes.solids import box, placed_solid


def pair(rng: np.random.Generator) -> list[Piece]:
    """Two or three figures close together, often with loads between them, on one ground."""
    makers = {"biped": biped, "quadruped": quadruped, "bird": bird}
    pieces: list[Piece] = []
    gap = between(rng, 0.35, 0.7)
    spots = [np.array([-gap, 0, 0]), np.array([gap, between(rng, -0.2, 0.2), 0])]
    if chance(rng, 0.3):
        spots.append(np.array([between(rng, -0.2, 0.2), between(rng, 0.5, 0.9), between(rng, 0.0, 0.2)]))
    for spot in spots:
        maker = makers[picked(rng, tuple(makers), (5, 2, 1))]
        turn = turn_about((0, 0, 1), between(rng, -25, 60) * np.sign(spot[0]))
        scale = between(rng, 0.7, 1.0) * (0.8 if maker is biped else 0.7)
        pieces += [_placed(piece, turn, scale, spot) for piece in maker(rng)]
    for _ in range(picked(rng, (0, 1, 2, 4), (2, 5, 3, 2))):
        size = between(rng, 0.2, 0.45)
        pieces += thing(
            rng, np.array([between(rng, -0.25, 0.25), between(rng, -0.7, 0.0), between(rng, 0.9, 1.6) * size]), size
        )
    if chance(rng, 0.7):
        pieces.append(box((0, 0, -0.08), (between(rng, 1.0, 1.3), between(rng, 0.7, 1.0), 0.1), 0.03, part=BASE))
    return pieces


def _placed(piece: Piece, axes: NDArray[np.float64], scale: float, offset: NDArray[np.float64]) -> Piece:
    if isinstance(piece, Shape):
        return placed(piece, axes, scale, offset)
    return placed_solid(piece, axes, scale, offset)
