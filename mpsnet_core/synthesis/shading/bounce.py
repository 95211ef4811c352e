"""Indirect light: diffuse bounces, gathered at every second pixel and smoothed along the surface."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.synthesis.shading.directions import disc, frames, tiled
from mpsnet_core.synthesis.shading.lights import Light
from mpsnet_core.synthesis.shading.surface_points import Surface, SurfacePoints

RAYS = 8
STRIDE = 2
_TILE = 4
_BLOCK = 1 << 11  # points whose paths are traced at a time
# Radius of the smoothing in gathering pixels. Weights fall where normals or tangent planes differ.
REACH = 2
_PLANE_REACH = 3.0  # gathering pixels
_SQUARINGS = 5  # weights are the cosine between normals to the power 2^5

Albedo = Callable[[SurfacePoints], NDArray[np.float32]]


def indirect(
    surface: Surface,
    lights: Sequence[Light],
    points: SurfacePoints,
    pixels: NDArray[np.int64],
    shape: tuple[int, int],
    stride: int,
    footprint: float,
    albedo: Albedo,
    bounces: int,
) -> NDArray[np.float32]:
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
    surface: Surface,
    lights: Sequence[Light],
    points: SurfacePoints,
    tile: NDArray[np.int64],
    albedo: Albedo,
    bounces: int,
) -> NDArray[np.float32]:
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


def _cosine_distributed(places: NDArray[np.float32], points: SurfacePoints) -> NDArray[np.float32]:
    """(N, 3) cosine-distributed directions above the points, from points (N, 2) on the unit disc (Malley's method)."""
    first, second = frames(points.smooth)
    x, y = places.T[..., None]
    return x * first + y * second + np.sqrt(np.maximum(1 - x * x - y * y, 0)) * points.smooth


class _Grid:
    """Values gathered on a regular grid of pixels, with the surface there.

    shape: of the grid. at: (N,) indices of the points in the grid, in row-major order. values: (N, K). step: distance
    between neighbouring grid points on the surface.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        at: NDArray[np.int64],
        normals: NDArray[np.float32],
        positions: NDArray[np.float32],
        values: NDArray[np.float32],
        step: float,
    ) -> None:
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

    def sampled(
        self, row: NDArray[np.float64], column: NDArray[np.float64], points: SurfacePoints
    ) -> NDArray[np.float32]:
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

    def _alike(
        self,
        normals: NDArray[np.float32],
        positions: NDArray[np.float32],
        other_normals: NDArray[np.float32],
        other_positions: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """(N,) similarity of two surface elements, 0 to 1."""
        alike: NDArray[np.float32] = np.maximum(dot(normals, other_normals), 0)
        for _ in range(_SQUARINGS):
            alike *= alike
        plane = dot(normals, other_positions - positions)
        alike *= np.maximum(1 - np.abs(plane) * self.scale, 0)
        return alike
