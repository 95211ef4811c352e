"""Procedural noise in space, from a seed: smooth random fields and random cells."""

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, I64, Floats
from mpsnet_core.arrays.unit_vectors import quaternion_matrix

Points = Floats
# Points processed at a time: temporary arrays stay in the processor's cache.
_CHUNK = 1 << 13
_AXES = (np.uint32(0x9E3779B1), np.uint32(0x85EBCA77), np.uint32(0xC2B2AE3D))
_SCALE = np.float32(1.6)


def gradient_noise(points: Points, seed: int) -> F32:
    """Smooth noise with features of about unit length: (N, 3) points to (N,) values, about -1 to 1, mean 0.

    Improved Perlin noise (Perlin 2002), which has a continuous second derivative, with 256 unit gradients. The seed
    rotates and shifts the lattice: no axis is preferred, and fields of different seeds share no zeros.
    """
    points = np.asarray(points)
    values = np.empty(len(points), np.float32)
    for chunk in bands(len(points), _CHUNK):
        values[chunk] = _gradient_noise(points[chunk], seed)
    return values


def fractal_noise(points: Points, seed: int, octaves: int) -> F32:
    """Fractal noise: sum of `octaves` of gradient noise, each with twice the frequency and half the amplitude.

    (N, 3) points to (N,) values, about -1 to 1. The amplitude does not depend on the number of octaves.
    """
    points = np.asarray(points)
    total: F32 = np.zeros(len(points), np.float32)
    power = 0.0
    for octave in range(octaves):
        amplitude = 0.5**octave
        total += np.float32(amplitude) * gradient_noise(points * 2.0**octave, seed + 0x1F3D5B79 * octave)
        power += amplitude**2
    total /= np.sqrt(np.float32(power))
    return total


def voronoi(points: Points, seed: int) -> tuple[I64, I64, F32]:
    """Cells of about unit width around random centres (Worley 1996), at points (N, 3).

    Returns a uniformly distributed ID of each point's cell (N,), 0 to 2³² - 1; the ID of the neighbour with the nearest
    border (N,); and the distance to that border (N,), in units of length.
    """
    points = np.asarray(points)
    cell, neighbour = np.empty((2, len(points)), np.int64)
    border = np.empty(len(points), np.float32)
    for chunk in bands(len(points), _CHUNK):
        cell[chunk], neighbour[chunk], border[chunk] = _voronoi(points[chunk], seed)
    return cell, neighbour, border


def _gradient_noise(points: Points, seed: int) -> F32:
    cells, fractions = _lattice(points, seed)
    key = _key(seed)
    # Along each axis: hashes of both neighbours, offsets from them, and the interpolation weight of the second.
    hashes = [(h := cell * axis, h + axis) for cell, axis in zip(cells, _AXES, strict=True)]
    offsets = [(f, f - np.float32(1)) for f in fractions]
    fades = [f * f * f * (f * (f * np.float32(6) - np.float32(15)) + np.float32(10)) for f in fractions]
    corners = []
    for i, j, k in product((0, 1), repeat=3):
        index = _mixed(hashes[0][i] + hashes[1][j] + hashes[2][k], key) >> np.uint32(24)
        gx, gy, gz = (component.take(index) for component in _gradients())
        corners.append(gx * offsets[0][i] + gy * offsets[1][j] + gz * offsets[2][k])
    for fade in reversed(fades):
        corners = [a + fade * (b - a) for a, b in zip(corners[::2], corners[1::2], strict=True)]
    return corners[0] * _SCALE


def _voronoi(points: Points, seed: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32], F32]:
    cells, fractions = _lattice(points, seed)
    key = _key(seed)
    count = len(points)
    neighbours = list(product((-1, 0, 1), repeat=3))
    numbers = np.empty((27, count), np.uint32)
    centres = np.empty((27, 3, count), np.float32)  # relative to the point
    for n, steps in enumerate(neighbours):
        total = np.zeros(count, np.uint32)
        for cell, axis, step in zip(cells, _AXES, steps, strict=True):
            total += (cell + np.uint32(step & 0xFFFFFFFF)) * axis
        numbers[n] = _mixed(total, key)
        bits = _mixed(numbers[n], _AXES[0])
        for along in range(3):
            # Centres keep away from the faces of lattice cells: the nearest one is always among the 27.
            jitter = ((bits >> np.uint32(10 * along)) & np.uint32(1023)).astype(np.float32) * np.float32(0.8 / 1023)
            centres[n, along] = (jitter + np.float32(0.1 + steps[along])) - fractions[along]
    squares = centres[:, 0] ** 2 + centres[:, 1] ** 2 + centres[:, 2] ** 2
    every = np.arange(count)
    nearest = squares.argmin(axis=0)
    own, own_square = centres[nearest, :, every], squares[nearest, every]
    apart = ((centres - own.T) ** 2).sum(axis=1)
    # The border to a neighbour is the plane halfway between both centres.
    apart[nearest, every] = np.inf
    border = (squares - own_square) / (np.float32(2) * np.sqrt(np.maximum(apart, np.float32(1e-12))))
    border[nearest, every] = np.inf
    closest = border.argmin(axis=0)
    return numbers[nearest, every], numbers[closest, every], border[closest, every]


def _lattice(points: Points, seed: int) -> tuple[list[NDArray[np.uint32]], list[F32]]:
    """Lattice cells (modulo 2³²) and positions in them, per axis, after the seed's rotation and shift."""
    turn, shift = _frame(seed)
    x, y, z = (points[:, axis].astype(np.float64) for axis in range(3))
    cells, fractions = [], []
    for row, offset in zip(turn, shift, strict=True):
        place = x * row[0] + y * row[1] + z * row[2] + offset
        floor = np.floor(place)
        cells.append(floor.astype(np.int64).astype(np.uint32))
        fractions.append((place - floor).astype(np.float32))
    return cells, fractions


@lru_cache(maxsize=256)
def _frame(seed: int) -> tuple[list[list[float]], list[float]]:
    rng = np.random.Generator(np.random.PCG64(int(_key(seed))))
    while True:  # a uniformly random unit quaternion, by rejection
        q = rng.random(4) * 2 - 1
        square = float(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        if 0.01 < square <= 1:
            break
    w, x, y, z = (float(c) for c in q / np.sqrt(square))
    return quaternion_matrix(w, x, y, z), (rng.random(3) * 1024).tolist()


@lru_cache(maxsize=1)
def _gradients() -> tuple[F32, ...]:
    """256 uniformly distributed unit vectors, by Marsaglia's method (1972)."""
    rng = np.random.Generator(np.random.PCG64(20020721))
    pairs = rng.random((1024, 2)) * 2 - 1
    pairs = pairs[pairs[:, 0] ** 2 + pairs[:, 1] ** 2 < 1][:128]
    square = pairs[:, 0] ** 2 + pairs[:, 1] ** 2
    root = 2 * np.sqrt(1 - square)
    half = np.stack([pairs[:, 0] * root, pairs[:, 1] * root, 1 - 2 * square])
    both = np.concatenate([half, -half], axis=1).astype(np.float32)
    return both[0], both[1], both[2]


def _mixed(values: NDArray[np.uint32], key: np.uint32) -> NDArray[np.uint32]:
    """The finaliser of MurmurHash3."""
    values = values ^ key
    values ^= values >> np.uint32(16)
    values *= np.uint32(0x85EBCA6B)
    values ^= values >> np.uint32(13)
    values *= np.uint32(0xC2B2AE35)
    values ^= values >> np.uint32(16)
    return values


def _key(seed: int) -> np.uint32:
    # Decorrelate neighbouring seeds, and fold seeds of more than 32 bits.
    seed &= 0xFFFFFFFFFFFFFFFF
    return np.uint32(((seed ^ (seed >> 32)) * 0x9E3779B1 + 0x7F4A7C15) & 0xFFFFFFFF)
