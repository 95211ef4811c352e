"""Solids: implicit forms given by their signed distance, blended smoothly or cut out of each other.

Distances and blends after Inigo Quilez, "Distance functions" and "Smooth minimum" (iquilezles.org, 2008 to 2024).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
WORLD: Array = np.eye(3)


@dataclass(frozen=True)
class Solid:
    """One form in the place where it stands.

    distance: local points (3, N) to (N,) signed distances, below 0 inside; exact near the surface, elsewhere within a
        third. axes: (3, 3), rows are the local axes. half: (3,) half the size of a local box around it.
    blend: width over which it flows into what came before it, 0 for a sharp joint. carve: cut it out instead.
    part: number of the part that it makes.
    """

    distance: Callable[[Array], Array]
    centre: Array
    axes: Array
    half: Array
    blend: float
    part: int
    carve: bool = False

    def signed_distance(self, points: Array) -> Array:
        """(N,) signed distances of points (3, N)."""
        return self.distance(self.local(points))

    def local(self, points: Array) -> Array:
        """Points (3, N) in the solid's own axes."""
        x, y, z = (points[axis] - self.centre[axis] for axis in range(3))
        if self.axes is WORLD:
            return np.stack([x, y, z])
        return np.stack([row[0] * x + row[1] * y + row[2] * z for row in self.axes])


def limb(
    start: ArrayLike, end: ArrayLike, r1: float, r2: float, *, blend: float = 0.0, part: int = 0, carve: bool = False
) -> Solid:
    """A round-ended cone from `start` (radius r1) to `end` (radius r2): limbs, necks, horns; a ball where they meet."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    along = b - a
    square = max(float(along @ along), 1e-12)

    def distance(p: Array) -> Array:
        t = np.clip((p[0] * along[0] + p[1] * along[1] + p[2] * along[2]) / square + 0.5, 0, 1)
        x, y, z = (p[axis] - (t - 0.5) * along[axis] for axis in range(3))
        return np.sqrt(x * x + y * y + z * z) - (r1 + (r2 - r1) * t)

    half = np.abs(along) / 2 + max(r1, r2)
    return Solid(distance, (a + b) / 2, WORLD, half, blend, part, carve)


def ellipsoid(
    centre: ArrayLike,
    radii: ArrayLike,
    axes: ArrayLike | None = None,
    *,
    blend: float = 0.0,
    part: int = 0,
    carve: bool = False,
) -> Solid:
    """An ellipsoid: heads, bodies, ears, cheeks."""
    r = np.broadcast_to(np.asarray(radii, np.float64), 3)

    def distance(p: Array) -> Array:
        x, y, z = (p[axis] / r[axis] for axis in range(3))
        k0 = np.sqrt(x * x + y * y + z * z)
        x, y, z = x / r[0], y / r[1], z / r[2]
        return k0 * (k0 - 1) / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-9)

    return Solid(distance, np.asarray(centre, np.float64), _axes(axes), r.copy(), blend, part, carve)


def box(
    centre: ArrayLike,
    half: ArrayLike,
    rounding: float,
    axes: ArrayLike | None = None,
    *,
    blend: float = 0.0,
    part: int = 0,
    carve: bool = False,
) -> Solid:
    """A box with rounded edges; `half` its half sizes with the rounding."""
    full = np.broadcast_to(np.asarray(half, np.float64), 3)
    inner = full - rounding

    def distance(p: Array) -> Array:
        x, y, z = (np.abs(p[axis]) - inner[axis] for axis in range(3))
        outside = np.sqrt(np.maximum(x, 0) ** 2 + np.maximum(y, 0) ** 2 + np.maximum(z, 0) ** 2)
        return outside + np.minimum(np.maximum(np.maximum(x, y), z), 0) - rounding

    return Solid(distance, np.asarray(centre, np.float64), _axes(axes), full.copy(), blend, part, carve)


def cylinder(
    centre: ArrayLike,
    radius: float,
    half_height: float,
    rounding: float,
    axes: ArrayLike | None = None,
    *,
    blend: float = 0.0,
    part: int = 0,
    carve: bool = False,
) -> Solid:
    """A cylinder about its local z axis with rounded rims: discs, wheels, drums."""

    def distance(p: Array) -> Array:
        across = np.sqrt(p[0] * p[0] + p[1] * p[1]) - (radius - rounding)
        along = np.abs(p[2]) - (half_height - rounding)
        outside = np.sqrt(np.maximum(across, 0) ** 2 + np.maximum(along, 0) ** 2)
        return outside + np.minimum(np.maximum(across, along), 0) - rounding

    half = np.array([radius, radius, half_height])
    return Solid(distance, np.asarray(centre, np.float64), _axes(axes), half, blend, part, carve)


def ring(
    centre: ArrayLike,
    radius: float,
    thickness: float,
    axes: ArrayLike | None = None,
    *,
    height: float = 1.0,
    blend: float = 0.0,
    part: int = 0,
    carve: bool = False,
) -> Solid:
    """A ring about its local z axis, `thickness` its tube's radius, `height` times as high: scarves, collars, tyres."""

    def distance(p: Array) -> Array:
        across = np.sqrt(p[0] * p[0] + p[1] * p[1]) - radius
        along = p[2] / height
        return (np.sqrt(across * across + along * along) - thickness) * min(1.0, height)

    half = np.array([radius + thickness, radius + thickness, thickness * height])
    return Solid(distance, np.asarray(centre, np.float64), _axes(axes), half, blend, part, carve)


def curved_limb(
    path: Sequence[ArrayLike], radii: ArrayLike, *, blend: float = 0.0, part: int = 0, pieces: int = 5
) -> list[Solid]:
    """A limb along the quadratic Bézier curve of three points, its radius through the three radii."""
    a, b, c = (np.asarray(point, np.float64) for point in path)
    steps = np.linspace(0, 1, pieces + 1)
    weights = [((1 - t) ** 2, 2 * t * (1 - t), t * t) for t in steps]
    points = [u * a + v * b + w * c for u, v, w in weights]
    thick = np.array(weights) @ np.asarray(radii, np.float64)
    return [
        limb(points[k], points[k + 1], thick[k], thick[k + 1], blend=blend if k == 0 else 0.6 * thick[k], part=part)
        for k in range(pieces)
    ]


def blended(a: Array, b: Array, width: float) -> Array:
    """Smooth minimum of two distances, with a continuous second derivative."""
    lowest = np.minimum(a, b)
    if width <= 0:
        return lowest
    overlap = np.maximum(1 - np.abs(a - b) / width, 0)
    return lowest - overlap * overlap * overlap * (width / 6)


def _axes(axes: ArrayLike | None) -> Array:
    return WORLD if axes is None else np.asarray(axes, np.float64)


def placed_solid(solid: Solid, axes: Array, scale: float, offset: Array) -> Solid:
    """The solid turned, scaled and moved as :func:`mpsnet_core.synthesis.shapes.shape.placed` does with shapes."""
    distance = solid.distance
    return replace(
        solid,
        distance=lambda points: distance(points / scale) * scale,
        centre=solid.centre @ axes * scale + offset,
        axes=solid.axes @ axes,
        half=solid.half * scale,
        blend=solid.blend * scale,
    )
