"""Random draws for recipes, shapes and captures."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from mpsnet_core.arrays.types import F64

Choice = TypeVar("Choice")


def generator(*key: int) -> np.random.Generator:
    """A random generator seeded with one or several integers."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def new_seed(rng: np.random.Generator) -> int:
    """A seed for an independent generator."""
    return int(rng.integers(1 << 62))


def uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from the uniform distribution between `low` and `high`."""
    return low + (high - low) * float(rng.random())


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number from the log-uniform distribution between `low` and `high`."""
    share = float(rng.random())
    return low if low == high else float(low * (high / low) ** share)


def chance(rng: np.random.Generator, probability: float) -> bool:
    """True with this probability."""
    return bool(rng.random() < probability)


def integer(rng: np.random.Generator, low: int, high: int) -> int:
    """An integer from `low` to `high`, inclusive."""
    return int(rng.integers(low, high + 1))


def choice(rng: np.random.Generator, choices: Sequence[Choice], weights: Sequence[float] | None = None) -> Choice:
    """One of the choices, equally likely or in proportion to their weights."""
    shares = np.cumsum(np.ones(len(choices)) if weights is None else weights)
    return choices[min(len(choices) - 1, int(np.searchsorted(shares, rng.random() * shares[-1], side="right")))]


def direction(rng: np.random.Generator) -> F64:
    """A uniformly distributed unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def rotation(rng: np.random.Generator) -> F64:
    """(3, 3) a uniformly distributed rotation; rows are its axes."""
    z, hint = direction(rng), direction(rng)
    x: F64 = np.cross(hint, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
