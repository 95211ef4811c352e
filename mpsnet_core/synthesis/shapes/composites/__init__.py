"""Composites: single objects of many parts that throw wide shadows on one another."""

from collections.abc import Callable, Sequence

import numpy as np

from mpsnet_core.synthesis.shapes.composites.assembly import Piece, assembled
from mpsnet_core.synthesis.shapes.composites.beasts import bird, octopus, quadruped
from mpsnet_core.synthesis.shapes.composites.constructions import dwelling, pile, robot, vehicle
from mpsnet_core.synthesis.shapes.composites.figures import biped, bust
from mpsnet_core.synthesis.shapes.composites.growths import growth, mushrooms, tangle
from mpsnet_core.synthesis.shapes.composites.pairs import pair
from mpsnet_core.synthesis.shapes.composites.vessels import full_sack, vessel
from mpsnet_core.synthesis.shapes.draws import picked
from mpsnet_core.synthesis.shapes.shape import Shape

Maker = Callable[[np.random.Generator], Sequence[Piece]]
# What there is to make and how often.
CHARACTERS: dict[str, tuple[Maker, float]] = {
    "biped": (biped, 24),
    "pair": (pair, 12),
    "quadruped": (quadruped, 16),
    "bust": (bust, 7),
    "bird": (bird, 6),
    "octopus": (octopus, 4),
    "vessel": (vessel, 8),
    "sack": (full_sack, 3),
    "robot": (robot, 5),
    "vehicle": (vehicle, 3),
    "dwelling": (dwelling, 3),
    "pile": (pile, 4),
    "growth": (growth, 5),
    "mushrooms": (mushrooms, 3),
    "tangle": (tangle, 3),
}
# Those that have no up and down.
WEIGHTLESS = ("growth", "tangle", "octopus")


def draw_character(rng: np.random.Generator) -> str:
    """The name of one of the characters."""
    return picked(rng, list(CHARACTERS), [weight for _, weight in CHARACTERS.values()])


def build_composite(character: str, rng: np.random.Generator, cells: int) -> Shape:
    """A composite of the character, about 2 high, z up; its smooth body on a grid of `cells` cells."""
    return assembled(CHARACTERS[character][0](rng), cells, rng)
