"""Groups: several objects next to each other on a ground."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.noise import fractal_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, integer, new_seed, rotation, uniform
from mpsnet_core.synthesis.shapes.blobs import CHARACTERS, build_blob
from mpsnet_core.synthesis.shapes.shape import Shape, fitted, joined, placed, standing, turn_about
from mpsnet_core.synthesis.shapes.surfaces import sheet, slab

Array = NDArray[np.float64]


def build_group(rng: np.random.Generator, cells: int) -> Shape:
    """Two to four blobs on a ground, z up."""
    blobs = [fitted(build_blob(choice(rng, CHARACTERS), rng, cells)) for _ in range(integer(rng, 2, 4))]
    return on_ground([placed(blob, rotation(rng)) for blob in blobs], rng)


def on_ground(objects: Sequence[Shape], rng: np.random.Generator) -> Shape:
    """Objects of radius 1, randomly rotated about z and scaled, close together on a ground; each is a part."""
    spots: list[tuple[float, float, float]] = []
    pieces = []
    for item in objects:
        scale = uniform(rng, 0.45, 1.0)
        item = standing(placed(item, turn_about((0, 0, 1), uniform(rng, 0, 360)), scale))
        middle = (item.vertices[:, :2].min(axis=0) + item.vertices[:, :2].max(axis=0)) / 2
        radius = 0.9 * float(np.sqrt(((item.vertices[:, :2] - middle) ** 2).sum(axis=1).max()))
        x, y = _free_spot(rng, spots, radius)
        spots.append((x, y, radius))
        pieces.append(placed(item, offset=(x - middle[0], y - middle[1], uniform(rng, -0.06, 0.0))))
    return joined([*pieces, _ground(rng, np.concatenate([piece.vertices[:, :2] for piece in pieces]))])


def _free_spot(rng: np.random.Generator, spots: list[tuple[float, float, float]], radius: float) -> tuple[float, float]:
    """A position where a disc hardly overlaps the others: the closest to the centre of some random tries."""
    if not spots:
        return 0.0, 0.0
    best, nearest = (0.0, 0.0), np.inf
    for _ in range(40):
        x, y, r = spots[int(rng.integers(len(spots)))]
        angle, away = uniform(rng, 0, 2 * np.pi), (r + radius) * uniform(rng, 0.95, 1.15)
        place = (x + away * np.cos(angle), y + away * np.sin(angle))
        free = all((place[0] - a) ** 2 + (place[1] - b) ** 2 > (0.9 * (r + radius)) ** 2 for a, b, r in spots)
        if free and place[0] ** 2 + place[1] ** 2 < nearest:
            best, nearest = place, place[0] ** 2 + place[1] ** 2
    return best


def _ground(rng: np.random.Generator, footprint: Array) -> Shape:
    """A plate, a disc or an uneven floor under a footprint (N, 2), with its top at about z = 0."""
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    spread = half * uniform(rng, 0.9, 1.2) + 0.05
    if chance(rng, 0.45):
        nodes = 120
        x, y = np.meshgrid(np.linspace(-1, 1, nodes) * spread[0], np.linspace(1, -1, nodes) * spread[1])
        seed, scale = new_seed(rng), uniform(rng, 0.8, 5)
        flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        steepness = uniform(rng, 0.01, 0.12) / np.sqrt(scale)
        height = steepness * fractal_noise(flat * scale, seed, 3).reshape(x.shape)
        front = np.stack([x, y, height], axis=-1)
        return placed(sheet(front, np.stack([x, y, np.full_like(x, -0.25)], axis=-1)), offset=(*middle, 0))
    angles = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    power = choice(rng, (1.0, 0.35))
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    outline = np.sign(circle) * np.abs(circle) ** power * spread * (1.1 if power == 1 else 1.0)
    return placed(slab(outline, 0.16, 0.03), offset=(*middle, -0.16))
