"""Indirect light: what other surfaces reflect, and what gloss mirrors."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I64
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.synthesis.reflectance import Reflectance
from mpsnet_core.synthesis.shading.directions import disc, frames, tiled
from mpsnet_core.synthesis.shading.lights import TURNS, Light
from mpsnet_core.synthesis.shading.surface_points import Surface, SurfacePoints

RAYS = 8
STRIDE = 2
_TILE = 4
_BLOCK = 1 << 11  # points whose paths are traced at a time
# Radius of the smoothing in gathering pixels. Weights fall where normals or tangent planes differ.
REACH = 2
_PLANE_REACH = 3.0  # gathering pixels
_SQUARINGS = 5  # weights are the cosine between normals to the power 2^5

Albedo = Callable[[SurfacePoints], F32]


def indirect(
    surface: Surface,
    lights: Sequence[Light],
    points: SurfacePoints,
    pixels: I64,
    shape: tuple[int, int],
    stride: int,
    footprint: float,
    albedo: Albedo,
    bounces: int,
) -> F32:
    """(N, lights, 3) radiance of a white matt surface at the points by light from other surfaces.

    pixels: (N,) indices of the points' pixels in an image of `shape`. stride: light is gathered at every `stride`-th
    pixel. footprint: size of a pixel on the surface. albedo: returns the diffuse colour (M, 3) of points that rays hit.
    bounces: maximum number of surfaces on the way to the points.
    """
    row, column = np.divmod(pixels, shape[1])
    chosen = np.flatnonzero((row % stride == stride // 2) & (column % stride == stride // 2))
    small = (-(-shape[0] // stride), -(-shape[1] // stride))
    at = row[chosen] // stride * small[1] + column[chosen] // stride
    gathered = _gathered(surface, lights, points.subset(chosen), tiled(_TILE, small).ravel()[at], albedo, bounces)
    grid = _Grid(small, at, points.smooth[chosen], points.position[chosen], gathered, footprint * stride)
    grid.smooth()
    down, right = (row - stride // 2) / stride, (column - stride // 2) / stride
    return grid.sampled(down, right, points).reshape(len(points), len(lights), 3)


def _gathered(
    surface: Surface, lights: Sequence[Light], points: SurfacePoints, tile: I64, albedo: Albedo, bounces: int
) -> F32:
    """(N, 3 lights) mean incoming radiance along a few cosine-distributed paths."""
    total = np.zeros((len(points), len(lights), 3), np.float32)
    places = disc(RAYS, _TILE**2).astype(np.float32)
    for block in bands(len(points), _BLOCK):
        # Trace a point's paths consecutively: they hit the same triangles nearby, which are then in the cache.
        first = np.repeat(np.arange(block.start, block.stop), RAYS)
        brought = np.zeros((len(first), len(lights), 3), np.float32)
        path, here, colour = np.arange(len(first)), points.subset(first), np.ones((len(first), 3), np.float32)
        for bounce in range(bounces):
            owner, ray = first[path], path % RAYS
            # A ray's number determines its elevation, and steep rays leave a hollow. Within a tile, each number is
            # followed by each other number equally often; otherwise paths through a hollow would be biased.
            chosen = (2 * bounce + 1) * tile[owner] + bounce
            of_bounce = ray + bounce * (bounce + 1) // 2 * tile[owner]
            place = places[chosen % _TILE**2, of_bounce % RAYS]
            heading = _cosine_distributed(place, here)
            hits = surface.scene.hits(here.start, heading)
            found = np.flatnonzero(hits.triangle >= 0)
            if not len(found):
                break
            here = surface.points(hits.subset(found), -heading.take(found, axis=0), bump=False)
            path, colour = path[found], colour.take(found, axis=0) * albedo(here)
            for number, light in enumerate(lights):
                direction = light.direction.astype(np.float32)
                cosine = here.smooth @ direction
                facing = np.flatnonzero(cosine > 0)
                free = facing[~surface.scene.occluded(here.start.take(facing, axis=0), direction[None])]
                brought[path[free], number] += cosine[free, None] * colour.take(free, axis=0)
        total[block] = brought.reshape(-1, RAYS, len(lights), 3).sum(axis=1)
    total /= RAYS
    return total.reshape(len(points), -1)


def _cosine_distributed(places: F32, points: SurfacePoints) -> F32:
    """(N, 3) cosine-distributed directions above the points, from points (N, 2) on the unit disc (Malley's method)."""
    first, second = frames(points.smooth)
    x, y = places.T[..., None]
    return x * first + y * second + np.sqrt(np.maximum(1 - x * x - y * y, 0)) * points.smooth


class _Grid:
    """Values gathered on a regular grid of pixels, with the surface there.

    shape: of the grid. at: (N,) indices of the points in the grid, in row-major order. values: (N, K). step: distance
    between neighbouring grid points on the surface.
    """

    def __init__(self, shape: tuple[int, int], at: I64, normals: F32, positions: F32, values: F32, step: float) -> None:
        # A border as wide as the smoothing radius avoids special cases. Normals are 0 where there is no surface.
        row, column = np.divmod(at, shape[1])
        self.width = shape[1] + 2 * REACH
        self.numbers = (row + REACH) * self.width + column + REACH
        self.scale = np.float32(1 / (_PLANE_REACH * step))
        count = (shape[0] + 2 * REACH) * self.width
        self.layers = [np.zeros((count, layer.shape[1]), np.float32) for layer in (normals, positions, values)]
        for layer, given in zip(self.layers, (normals, positions, values), strict=True):
            layer[self.numbers] = given

    def smooth(self) -> None:
        """Replace every value by a mean of its neighbourhood on the surface."""
        normals, positions, values = self.layers
        here = normals[self.numbers], positions[self.numbers]
        total, weights = np.zeros_like(values[self.numbers]), np.zeros((len(self.numbers), 1), np.float32)
        steps = range(-REACH, REACH + 1)
        for down, right in ((down, right) for down in steps for right in steps):
            near = np.float32(1 - (down**2 + right**2) / (2 * (REACH + 1) ** 2))
            other = self.numbers + down * self.width + right
            weight = (near * self._alike(*here, normals[other], positions[other]))[:, None]
            total += weight * values[other]
            weights += weight
        values[self.numbers] = total / weights  # a point's own weight is 1, so the sum is above 0

    def sampled(self, row: F64, column: F64, points: SurfacePoints) -> F32:
        """(N, K) values at points at rows and columns (N,) of the grid, interpolated from the nearest four."""
        normals, positions, values = self.layers
        top, left = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
        down, right = (row - top).astype(np.float32), (column - left).astype(np.float32)
        corner = (top + REACH) * self.width + left + REACH
        total, weights = np.zeros((len(points), values.shape[1]), np.float32), np.zeros((len(points), 1), np.float32)
        for step, near in (
            (0, (1 - down) * (1 - right)),
            (1, (1 - down) * right),
            (self.width, down * (1 - right)),
            (self.width + 1, down * right),
        ):
            number = corner + step
            alike = self._alike(points.smooth, points.position, normals[number], positions[number])
            # If no neighbour is similar, as on thin parts, use any of them.
            present = normals[number].any(axis=1)
            weight = ((near + np.float32(1e-3)) * (alike + np.float32(1e-3) * present))[:, None]
            total += weight * values[number]
            weights += weight
        total /= np.maximum(weights, 1e-9)
        return total

    def _alike(self, normals: F32, positions: F32, other_normals: F32, other_positions: F32) -> F32:
        """(N,) similarity of two surface elements, 0 to 1."""
        alike: F32 = np.maximum(dot(normals, other_normals), 0)
        for _ in range(_SQUARINGS):
            alike *= alike
        plane = dot(normals, other_positions - positions)
        alike *= np.maximum(1 - np.abs(plane) * self.scale, 0)
        return alike


# --- reflected direct light: reflectance averaged over a light's disc, because large lights widen highlights ----------
# The albedo and highlight width of each reflectance decide where the average needs more than the light's centre.


# Lights up to this share of the highlight's width are evaluated at their centre ...
POINT_LIKE = 0.35
# ... and up to this one at three points, which average any quadratic function over a disc exactly.
SMALL = 1.0
# Larger lights use this many samples on the light's disc, and in the lobe about the mirror direction.
DISC_POINTS, LOBE_POINTS = 12, 12
# Beyond this many widths from the mirror direction, the centre is sufficient for small and for large lights.
SMALL_REACH, GLOSS_REACH = 3.0, 6.0
# The direction to a light whose centre is just below the horizon is lifted to this cosine.
MIN_COSINE = 0.02
# Angles from the normal at which reflectance is measured, denser at the highlight's peak.
_ANGLES = (np.arange(96) + 0.5) / 96
_ANGLES, _STEPS = np.pi / 2 * _ANGLES**3, np.pi / 2 * 3 * _ANGLES**2 / 96


@dataclass(frozen=True)
class Lobe:
    """Properties of a reflectance at normal incidence."""

    albedo: F32
    """(3,) float32. Directional albedo."""
    width: float
    """Angle in radians at which the highlight falls to a half, infinite if there is none."""


def lobe(reflectance: Reflectance) -> Lobe:
    """Measure the albedo and highlight width of a reflectance."""
    up = np.tile(np.array([0, 0, 1], np.float32), (len(_ANGLES), 1))
    around = np.stack([np.sin(_ANGLES), 0 * _ANGLES, np.cos(_ANGLES)], axis=1).astype(np.float32)
    profile = reflectance(up, around, up, None).astype(np.float64)
    albedo = 2 * np.pi * (profile.T @ (np.sin(_ANGLES) * np.cos(_ANGLES) * _STEPS))
    mean = profile.mean(axis=1)
    matt = np.interp(np.pi / 3, _ANGLES, mean)
    peak = mean[0] - matt
    if peak <= 0.1 * matt:
        return Lobe(np.minimum(albedo, 1).astype(np.float32), np.inf)
    return Lobe(np.minimum(albedo, 1).astype(np.float32), float(_ANGLES[np.argmax(mean - matt < peak / 2)]))


def reflect_light(
    reflectance: Reflectance, width: float, light: Light, normals: F32, views: F32, paint: F32 | None, turns: I64
) -> F32:
    """(N, 3) radiance of points under an unoccluded light, divided by irradiance; 1 for a white matt surface.

    normals, views: (N, 3) unit vectors. paint: (N, 3) or None. width: of the reflectance's lobe. turns: (N,) integers
    below TURNS that rotate the samples.
    """
    middle = light.direction.astype(np.float32)
    cosine = normals @ middle
    radius = light.radius
    result: F32 = np.pi * reflectance(normals, _above(normals, middle, cosine), views, paint)
    if radius <= POINT_LIKE * width:
        return result
    mirrored = (2 * dot(normals, views))[:, None] * normals - views
    along = mirrored @ middle
    # Intersection of the mirror direction with the disc's plane, in units of its radius.
    mirror = mirrored @ (light.axes.T / radius).astype(np.float32)
    mirror /= np.maximum(along, 0.1)[:, None]
    small, spread = radius <= SMALL * width, width / radius
    reach = 1 + (SMALL_REACH if small else GLOSS_REACH) * spread
    near = np.flatnonzero((along > 0.1) & (np.hypot(*mirror.T) < reach) & (cosine > 0))
    if not len(near):
        return result
    normals, views, mirror = (vectors.take(near, axis=0) for vectors in (normals, views, mirror))
    turns = turns[near]
    paint = None if paint is None else paint.take(near, axis=0)
    total, shares = np.zeros((len(near), 3), np.float32), np.zeros((len(near), 1), np.float32)
    for places, weights in _three(turns) if small else _many(mirror, np.float32(spread), turns):
        towards = light.direction.astype(np.float32) + (places * np.float32(radius)) @ light.axes.astype(np.float32)
        towards /= np.sqrt(dot(towards, towards))[:, None]
        share = (np.maximum(dot(normals, towards), 0) * weights)[:, None]
        used = np.flatnonzero(share)
        some = None if paint is None else paint[used]
        total[used] += share[used] * reflectance(normals[used], towards[used], views[used], some)
        shares += share
    result[near] = np.pi * total / np.maximum(shares, 1e-6)
    return result


def _above(normals: F32, middle: F32, cosine: F32) -> F32:
    """(N, 3) directions to the light's centre, lifted above the horizon."""
    towards = np.broadcast_to(middle, normals.shape)
    below = np.flatnonzero(cosine < MIN_COSINE)
    if len(below):
        towards = towards.copy()
        towards[below] += (np.float32(MIN_COSINE) - cosine[below])[:, None] * normals[below]
        towards[below] /= np.sqrt(dot(towards[below], towards[below]))[:, None]
    return towards


Places = Iterator[tuple[F32, F32]]
"""Point after point of a disc: where (N, 2), its rim the unit circle, and with which weight (N,) or () for all."""


def _three(turns: I64) -> Places:
    angles = 2 * np.pi * (np.arange(TURNS) / TURNS + np.arange(3)[:, None]) / 3
    for places in (np.stack([np.cos(angles), np.sin(angles)], axis=-1) / np.sqrt(2)).astype(np.float32):
        yield places[turns], np.array(1 / 3, np.float32)


def _many(mirror: F32, spread: np.float32, turns: I64) -> Places:
    """Samples of the disc and of the lobe, combined by the balance heuristic (Veach 1997).

    mirror: (N, 2) intersection of the mirror direction with the disc's plane. spread: width of the lobe there.
    """

    def weights(places: F32) -> F32:
        square = ((places - mirror) ** 2).sum(axis=1)
        density = spread**2 / (square + spread**2) ** 2 / within
        return ((places**2).sum(axis=1) <= 1) / (DISC_POINTS + LOBE_POINTS * density)

    farthest = np.hypot(*mirror.T) + 1
    within = farthest**2 / (farthest**2 + spread**2)  # share of the lobe within reach of the disc's farthest point
    for places in disc(DISC_POINTS, TURNS).astype(np.float32).swapaxes(0, 1):
        yield places[turns], weights(places[turns])
    for places in disc(LOBE_POINTS, TURNS).swapaxes(0, 1):
        # Sample a GGX-like highlight: a share t of it is within the width times sqrt(t / (1 - t)).
        radius = np.hypot(*places.T)
        outwards, share = (places / radius[:, None]).astype(np.float32), (radius**2).astype(np.float32)
        share = np.minimum(share[turns], 1) * within
        about = mirror + (spread * np.sqrt(share / (1 - share)))[:, None] * outwards[turns]
        yield about, weights(about)
