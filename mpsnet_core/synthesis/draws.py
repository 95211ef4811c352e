"""Draws: the few ways in which recipes, shapes and captures take random numbers."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Choice = TypeVar("Choice")


def generator(*key: int) -> np.random.Generator:
    """The stream of random numbers that belongs to a seed, or to several numbers together."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def new_seed(rng: np.random.Generator) -> int:
    """A seed for a stream of its own."""
    return int(rng.integers(1 << 62))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from `low` to `high`, uniformly distributed."""
    return low + (high - low) * float(rng.random())


def between_log(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from `low` to `high`, whose logarithm is uniformly distributed."""
    share = float(rng.random())
    return low if low == high else float(low * (high / low) ** share)


def chance(rng: np.random.Generator, probability: float) -> bool:
    """True with this probability."""
    return bool(rng.random() < probability)


def count(rng: np.random.Generator, low: int, high: int) -> int:
    """A whole number from `low` to `high`, both included."""
    return int(rng.integers(low, high + 1))


def picked(rng: np.random.Generator, choices: Sequence[Choice], weights: Sequence[float] | None = None) -> Choice:
    """One of the choices, all equally likely or in proportion to their weights."""
    shares = np.cumsum(np.ones(len(choices)) if weights is None else weights)
    return choices[min(len(choices) - 1, int(np.searchsorted(shares, rng.random() * shares[-1], side="right")))]


def direction(rng: np.random.Generator) -> NDArray[np.float64]:
    """A unit vector, uniformly distributed."""
    vector = rng.normal(size=3)
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    """(3, 3) rows are the axes of a random rotation, uniformly distributed."""
    z, hint = direction(rng), direction(rng)
    x: NDArray[np.float64] = np.cross(hint, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
