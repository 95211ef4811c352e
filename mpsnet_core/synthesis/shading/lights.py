"""Visibility of distant area lights: attached and cast shadows, with penumbrae."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.synthesis.shading.directions import disc, frames, tiled
from mpsnet_core.synthesis.shading.surface_points import SurfacePoints

# Cast one ray per pixel to a point near the light's rim, which differs between pixels. If all rays in a neighbourhood
# agree, they are sufficient; elsewhere there is a penumbra, and this many more are cast.
PENUMBRA_RAYS, FIRST_RAYS = 16, 5
TURNS = 64
RIM = 0.9
_TILE = 4
# Points processed at a time: their data stays in a core's cache.
_BLOCK = 1 << 12


@dataclass(frozen=True)
class Light:
    """A distant white light of irradiance pi."""

    direction: F64
    """(3,) float64. Unit vector from the origin to its centre."""
    size: float
    """Angular diameter in degrees."""

    @property
    def radius(self) -> float:
        """Radius of the light's disc at distance 1."""
        return float(np.tan(np.radians(self.size / 2)))

    @property
    def axes(self) -> F64:
        """(2, 3) two orthogonal unit vectors in the plane of the disc."""
        return np.concatenate(frames(self.direction[None]))

    def towards(self, places: F64) -> F32:
        """(..., 3) vectors to positions (..., 2) on the light, whose rim is the unit circle. Not normalised: their mean
        is the light's direction."""
        return (self.direction + self.radius * places @ self.axes).astype(np.float32)


def illumination(
    light: Light, points: SurfacePoints, scene: RayScene, pixels: I64, shape: tuple[int, int], turns: I64
) -> F32:
    """Light that arrives at the points, which are at pixels (N,) of an image of `shape`.

    Returns (2, N) irradiance, 1 on an unoccluded surface facing the light; and the visible share of the light's disc
    above the horizon of the shading normal.

    turns: (N,) random integers below TURNS that rotate the rays of each point.
    """
    direction = light.direction.astype(np.float32)
    cosine, above = points.normal @ direction, points.smooth @ direction
    radius = light.radius
    irradiance, lit = arriving = np.zeros((2, len(points)), np.float32)
    facing = np.flatnonzero((cosine > -radius) & (above > -radius))
    start = points.start.take(facing, axis=0)
    if not radius:
        free = ~scene.occluded(start, direction[None])
        irradiance[facing], lit[facing] = free * cosine[facing], free
        return arriving

    angle = 2 * np.pi * np.arange(_TILE**2) / _TILE**2
    rim = light.towards(RIM * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    places = tiled(_TILE, shape).take(pixels.take(facing))
    free = ~scene.occluded(start, rim.take(places, axis=0))
    found = np.zeros((*shape, 2), bool)
    found.reshape(-1, 2)[pixels[facing]] = np.stack([free, ~free], axis=1)
    unsure = dilated(found, 1).all(axis=-1).ravel()[pixels[facing]]
    unsure |= np.minimum(cosine[facing], above[facing]) < radius  # the horizon may cut the light's disc
    sure = facing[~unsure]
    lit[sure] = free[~unsure]
    irradiance[sure] = cosine[sure] * lit[sure]

    _cast_many(light, points, scene, facing[unsure], turns, arriving)
    return arriving


def _cast_many(light: Light, points: SurfacePoints, scene: RayScene, chosen: I64, turns: I64, arriving: F32) -> None:
    """Compute the light at the chosen points by rays to many positions on the light; fewer if the first ones agree."""
    irradiance, lit = arriving
    places = disc(PENUMBRA_RAYS, TURNS)
    places -= places.mean(axis=1, keepdims=True)
    towards = light.towards(places)[:, ::-1]  # from the rim inwards
    for block in bands(len(chosen), _BLOCK):
        some = chosen[block]
        _cast(towards[:, :FIRST_RAYS], points, scene, some, turns, arriving)
        mixed = (lit[some] > 0) & (lit[some] < FIRST_RAYS)
        settled, some = some[~mixed], some[mixed]
        lit[settled] /= FIRST_RAYS
        irradiance[settled] = lit[settled] * (points.normal[settled] @ light.direction.astype(np.float32))
        _cast(towards[:, FIRST_RAYS:], points, scene, some, turns, arriving)
        arriving[:, some] /= PENUMBRA_RAYS


def _cast(towards: F32, points: SurfacePoints, scene: RayScene, chosen: I64, turns: I64, arriving: F32) -> None:
    """Cast rays along `towards` (TURNS, K, 3), and add their irradiance and visibility to the chosen points.

    A point's rays are consecutive: they hit the same triangles, which are then in the cache.
    """
    turn = turns[chosen]
    x, y, z = (table[turn] for table in np.moveaxis(towards, 2, 0))

    def cosines(normals: F32) -> F32:
        a, b, c = normals.take(chosen, axis=0).T[..., None]
        return a * x + b * y + c * z

    share = cosines(points.normal)
    up = (share > 0) & (cosines(points.smooth) > 0)
    owner, number = np.nonzero(up)
    headings = towards.reshape(-1, 3).take(turn[owner] * towards.shape[1] + number, axis=0)
    arrives = ~scene.occluded(points.start.take(chosen[owner], axis=0), headings)
    share[~up] = 0
    share[up] *= arrives
    arriving[0, chosen] += share.sum(axis=1)
    arriving[1, chosen] += np.bincount(owner[arrives], minlength=len(chosen))
