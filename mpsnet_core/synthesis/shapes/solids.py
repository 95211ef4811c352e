"""Solids: implicit surfaces by signed distance functions, blended smoothly or subtracted from each other.

Distances and blends after Inigo Quilez, "Distance functions" and "Smooth minimum" (iquilezles.org, 2008 to 2024).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
WORLD: Array = np.eye(3)


@dataclass(frozen=True)
class Solid:
    """A positioned solid."""

    distance: Callable[[Array], Array]
    """Maps local points (3, N) to signed distances (N,), below 0 inside; exact near the surface, elsewhere within a
    third."""
    centre: Array
    """(3,). Position of its centre."""
    axes: Array
    """(3, 3). Rows are the local axes."""
    half: Array
    """(3,). Half the size of its local bounding box."""
    blend: float = 0.0
    """Width of the blend with the solids before it, 0 for a sharp joint."""
    carve: bool = False
    """Whether to subtract it instead."""

    def signed_distance(self, points: Array) -> Array:
        """(N,) signed distances of points (3, N)."""
        return self.distance(self.local(points))

    def local(self, points: Array) -> Array:
        """Points (3, N) in the solid's local space."""
        x, y, z = (points[axis] - self.centre[axis] for axis in range(3))
        if self.axes is WORLD:
            return np.stack([x, y, z])
        return np.stack([row[0] * x + row[1] * y + row[2] * z for row in self.axes])


def limb(start: ArrayLike, end: ArrayLike, r1: float, r2: float, *, blend: float = 0.0, carve: bool = False) -> Solid:
    """A round cone from `start` (radius r1) to `end` (radius r2); a ball if they coincide."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    along = b - a
    square = max(float(along @ along), 1e-12)

    def distance(p: Array) -> Array:
        t: Array = np.clip((p[0] * along[0] + p[1] * along[1] + p[2] * along[2]) / square + 0.5, 0, 1)
        return lengths(p - (t - 0.5) * along[:, None]) - (r1 + (r2 - r1) * t)

    half = np.abs(along) / 2 + max(r1, r2)
    return Solid(distance, (a + b) / 2, WORLD, half, blend, carve)


def ellipsoid(
    centre: ArrayLike, radii: ArrayLike, axes: ArrayLike = WORLD, *, blend: float = 0.0, carve: bool = False
) -> Solid:
    """An ellipsoid."""
    r = np.broadcast_to(np.asarray(radii, np.float64), 3)[:, None]

    def distance(p: Array) -> Array:
        scaled = lengths(p / r)
        return scaled * (scaled - 1) / np.maximum(lengths(p / r / r), 1e-9)

    return Solid(distance, np.asarray(centre, np.float64), np.asarray(axes, np.float64), r[:, 0], blend, carve)


def box(centre: ArrayLike, half: ArrayLike, rounding: float, axes: ArrayLike = WORLD) -> Solid:
    """A box with rounded edges. half: half of its size, including the rounding."""
    full = np.asarray(half, np.float64)

    def distance(p: Array) -> Array:
        return _rounded(np.abs(p) - (full - rounding)[:, None], rounding)

    return Solid(distance, np.asarray(centre, np.float64), np.asarray(axes, np.float64), full)


def cylinder(centre: ArrayLike, radius: float, half_height: float, rounding: float) -> Solid:
    """An upright cylinder with rounded rims."""

    def distance(p: Array) -> Array:
        outside = np.stack([lengths(p[:2]) - radius, np.abs(p[2]) - half_height]) + rounding
        return _rounded(outside, rounding)

    return Solid(distance, np.asarray(centre, np.float64), WORLD, np.array([radius, radius, half_height]))


def _rounded(outside: Array, rounding: float) -> Array:
    """(N,) distances from a rounded form. outside: (D, N) distances of points beyond its core along each axis."""
    return lengths(np.maximum(outside, 0)) + np.minimum(outside.max(axis=0), 0) - rounding


def blended(a: Array, b: Array, width: float) -> Array:
    """Smooth minimum of two distances, with a continuous second derivative."""
    distance: Array = np.minimum(a, b)
    if width > 0:
        overlap = np.maximum(1 - np.abs(a - b) / width, 0)
        distance = distance - overlap * overlap * overlap * (width / 6)
    return distance


def lengths(vectors: Array) -> Array:
    """(...) lengths of vectors (D, ...)."""
    return np.sqrt(np.einsum("i...,i...->...", vectors, vectors))
