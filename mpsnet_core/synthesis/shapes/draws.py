"""Draws: the few ways in which shapes take random numbers."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.shapes.shape import axes_along

Choice = TypeVar("Choice")


def generator(seed: int) -> np.random.Generator:
    """The stream of random numbers that belongs to a seed."""
    return np.random.Generator(np.random.PCG64(seed))


def new_seed(rng: np.random.Generator) -> int:
    """A seed for a stream of its own."""
    return int(rng.integers(1 << 62))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from `low` to `high`, all alike likely."""
    return low + (high - low) * float(rng.random())


def chance(rng: np.random.Generator, probability: float) -> bool:
    """True with this probability."""
    return bool(rng.random() < probability)


def count(rng: np.random.Generator, low: int, high: int) -> int:
    """A whole number from `low` to `high`, both included."""
    return int(rng.integers(low, high + 1))


def picked(rng: np.random.Generator, choices: Sequence[Choice], weights: Sequence[float] | None = None) -> Choice:
    """One of the choices, all alike likely or as their weights say."""
    shares = np.cumsum(np.ones(len(choices)) if weights is None else weights)
    return choices[min(len(choices) - 1, int(np.searchsorted(shares, rng.random() * shares[-1], side="right")))]


def direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """A unit vector, all alike likely."""
    vector = rng.normal(size=3)
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def turned(rng: np.random.Generator) -> NDArray[np.float64]:
    """Axes of a random rotation, all alike likely."""
    return axes_along(direction(rng), direction(rng))
