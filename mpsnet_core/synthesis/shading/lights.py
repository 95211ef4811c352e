"""How much of a distant light reaches points of the surface: cast and attached shadows, with penumbrae."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.scene.rays import RayScene
from mpsnet_core.synthesis.shading.directions import disc, frames, tiled
from mpsnet_core.synthesis.shading.surface_points import SurfacePoints

# Everywhere one ray goes to a place near the light's rim, another one from pixel to pixel. Where all of them agree in a
# pixel's neighbourhood they are enough, elsewhere there is a penumbra and so many more are cast.
PENUMBRA_RAYS, FIRST_RAYS = 16, 5
TURNS = 64
RIM = 0.9
_TILE = 4
# Points worked on at once: what they need stays in a core's own cache.
_BLOCK = 1 << 12
_FREE, _HIDDEN = np.uint8(1), np.uint8(2)


@dataclass(frozen=True)
class Light:
    """A distant white light of irradiance pi.

    direction: (3,) unit vector from the origin to its middle. size: angular diameter in degrees.
    """

    direction: NDArray[np.float64]
    size: float

    @property
    def radius(self) -> float:
        """Of the disc that the light is at the distance 1."""
        return float(np.tan(np.radians(self.size / 2)))

    @property
    def axes(self) -> NDArray[np.float64]:
        """(2, 3) two unit vectors along the disc."""
        return np.concatenate(frames(self.direction[None]))

    def towards(self, places: NDArray[np.float64]) -> NDArray[np.float32]:
        """(..., 3) from the origin to places (..., 2) on the light, whose rim is the unit circle. Not of unit length:
        their mean is the light's direction."""
        return (self.direction + self.radius * places @ self.axes).astype(np.float32)


@dataclass(frozen=True)
class Arrival:
    """What reaches N points from a light.

    irradiance: (N,) float32, 1 on a surface that faces the light freely. lit: (N,) float32, the share of the light's
    disc above the shading normal's horizon that nothing hides.
    """

    irradiance: NDArray[np.float32]
    lit: NDArray[np.float32]


def arrival(
    light: Light,
    points: SurfacePoints,
    scene: RayScene,
    pixels: NDArray[np.int64],
    shape: tuple[int, int],
    turns: NDArray[np.integer[Any]],
) -> Arrival:
    """What reaches the points, which pixels (N,) of an image of `shape` show.

    turns: (N,) numbers below TURNS, random, that turn the rays of each point.
    """
    direction = light.direction.astype(np.float32)
    cosine, above = points.normal @ direction, points.smooth @ direction
    radius = light.radius
    irradiance, lit = np.zeros((2, len(points)), np.float32)
    facing = np.flatnonzero((cosine > -radius) & (above > -radius))
    start = points.start.take(facing, axis=0)
    if not radius:
        free = ~scene.occluded(start, direction[None])
        irradiance[facing], lit[facing] = free * cosine[facing], free
        return Arrival(irradiance, lit)

    angle = 2 * np.pi * np.arange(_TILE**2) / _TILE**2
    rim = light.towards(RIM * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    places = tiled(_TILE, shape).take(pixels.take(facing))
    free = ~scene.occluded(start, rim.take(places, axis=0))
    found = np.zeros(shape, np.uint8)
    found.ravel()[pixels[facing]] = np.where(free, _FREE, _HIDDEN)
    unsure = _around(found).ravel()[pixels[facing]] == _FREE | _HIDDEN
    unsure |= np.minimum(cosine[facing], above[facing]) < radius  # the horizon cuts the light
    sure = facing[~unsure]
    lit[sure] = free[~unsure]
    irradiance[sure] = cosine[sure] * lit[sure]

    _cast_many(light, points, scene, facing[unsure], turns, irradiance, lit)
    return Arrival(irradiance, lit)


def _around(bits: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The bits (H, W) of each pixel and the eight around it together."""
    for axis in (0, 1):
        lines, joined = bits.swapaxes(0, axis), bits.copy()
        there = joined.swapaxes(0, axis)
        there[1:] |= lines[:-1]
        there[:-1] |= lines[1:]
        bits = joined
    return bits


def _cast_many(
    light: Light,
    points: SurfacePoints,
    scene: RayScene,
    chosen: NDArray[np.int64],
    turns: NDArray[np.integer[Any]],
    irradiance: NDArray[np.float32],
    lit: NDArray[np.float32],
) -> None:
    """Fill in what reaches the chosen points, from rays to many places on the light; fewer where the first agree."""
    places = disc(PENUMBRA_RAYS, TURNS)
    places -= places.mean(axis=1, keepdims=True)
    towards = light.towards(places)[:, ::-1]  # from the rim inwards
    for start in range(0, len(chosen), _BLOCK):
        some = chosen[start : start + _BLOCK]
        _cast(towards[:, :FIRST_RAYS], points, scene, some, turns, irradiance, lit)
        mixed = (lit[some] > 0) & (lit[some] < FIRST_RAYS)
        settled, some = some[~mixed], some[mixed]
        lit[settled] /= FIRST_RAYS
        irradiance[settled] = lit[settled] * (points.normal[settled] @ light.direction.astype(np.float32))
        _cast(towards[:, FIRST_RAYS:], points, scene, some, turns, irradiance, lit)
        irradiance[some] /= PENUMBRA_RAYS
        lit[some] /= PENUMBRA_RAYS


def _cast(
    towards: NDArray[np.float32],
    points: SurfacePoints,
    scene: RayScene,
    chosen: NDArray[np.int64],
    turns: NDArray[np.integer[Any]],
    irradiance: NDArray[np.float32],
    lit: NDArray[np.float32],
) -> None:
    """Add what rays bring along `towards` (TURNS, K, 3) to the chosen points, and how many of them arrive.

    A point's rays follow one another: they meet the same triangles, which are in the cache then.
    """
    turn = turns[chosen]
    x, y, z = (table[turn] for table in np.moveaxis(towards, 2, 0))

    def cosines(normals: NDArray[np.float32]) -> NDArray[np.float32]:
        a, b, c = normals.take(chosen, axis=0).T[..., None]
        cosine: NDArray[np.float32] = a * x + b * y + c * z
        return cosine

    share = cosines(points.normal)
    up = (share > 0) & (cosines(points.smooth) > 0)
    owner, number = np.nonzero(up)
    headings = towards.reshape(-1, 3).take(turn[owner] * towards.shape[1] + number, axis=0)
    arrives = ~scene.occluded(points.start.take(chosen[owner], axis=0), headings)
    share[~up] = 0
    share[up] *= arrives
    irradiance[chosen] += share.sum(axis=1)
    lit[chosen] += np.bincount(owner[arrives], minlength=len(chosen))
