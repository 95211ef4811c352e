"""Groups: several objects beside each other on a ground."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.synthesis.noise import fractal_noise
from mpsnet_core.synthesis.shapes.blobs import CHARACTERS as BLOBS
from mpsnet_core.synthesis.shapes.blobs import build_blob
from mpsnet_core.synthesis.shapes.composites import build_composite, draw_character
from mpsnet_core.synthesis.shapes.draws import between, chance, count, new_seed, picked, turned
from mpsnet_core.synthesis.shapes.shape import Shape, fitted, joined, placed, standing, turn_about
from mpsnet_core.synthesis.shapes.surfaces import sheet, slab

Array = NDArray[np.float64]
# Parts of the second object start here, of the third at twice this, and so on; the ground is the last.
PARTS_EACH = 8


def build_group(rng: np.random.Generator, cells: int) -> Shape:
    """Two to four composites and blobs on a ground, z up."""
    objects = []
    for _ in range(count(rng, 2, 4)):
        if chance(rng, 0.65):
            objects.append(fitted(build_composite(draw_character(rng), rng, cells)))
        else:
            blob = fitted(build_blob(picked(rng, BLOBS), rng, cells))
            objects.append(placed(blob, turned(rng)))
    return on_ground(objects, rng)


def on_ground(objects: Sequence[Shape], rng: np.random.Generator) -> Shape:
    """Objects of radius 1, turned about z and scaled at will, set close to each other on a ground."""
    spots: list[tuple[float, float, float]] = []
    pieces = []
    for number, thing in enumerate(objects):
        scale = between(rng, 0.45, 1.0)
        thing = standing(placed(thing, turn_about((0, 0, 1), between(rng, 0, 360)), scale))
        middle = (thing.vertices[:, :2].min(axis=0) + thing.vertices[:, :2].max(axis=0)) / 2
        radius = 0.9 * float(np.sqrt(((thing.vertices[:, :2] - middle) ** 2).sum(axis=1).max()))
        x, y = _free_spot(rng, spots, radius)
        spots.append((x, y, radius))
        thing = placed(thing, offset=(x - middle[0], y - middle[1], between(rng, -0.06, 0.0)))
        parts = (thing.parts % PARTS_EACH + PARTS_EACH * number).astype(np.int32)
        pieces.append(Shape(thing.vertices, thing.triangles, thing.corner_normals, parts))
    return joined(
        [*pieces, _ground(rng, np.concatenate([p.vertices[:, :2] for p in pieces]), PARTS_EACH * len(pieces))]
    )


def _free_spot(rng: np.random.Generator, spots: list[tuple[float, float, float]], radius: float) -> tuple[float, float]:
    """Where a disc touches none of the others and lies as near to the middle as a few tries find."""
    if not spots:
        return 0.0, 0.0
    best, nearest = (0.0, 0.0), np.inf
    for _ in range(40):
        x, y, r = spots[int(rng.integers(len(spots)))]
        angle, away = between(rng, 0, 2 * np.pi), (r + radius) * between(rng, 0.95, 1.15)
        place = (x + away * np.cos(angle), y + away * np.sin(angle))
        free = all((place[0] - a) ** 2 + (place[1] - b) ** 2 > (0.9 * (r + radius)) ** 2 for a, b, r in spots)
        if free and place[0] ** 2 + place[1] ** 2 < nearest:
            best, nearest = place, place[0] ** 2 + place[1] ** 2
    return best


def _ground(rng: np.random.Generator, footprint: Array, part: int) -> Shape:
    """A plate, a disc or an uneven floor under a footprint (N, 2), its upper side at about z = 0."""
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    spread = half * between(rng, 0.9, 1.2) + 0.05
    if chance(rng, 0.45):
        nodes = 120
        x, y = np.meshgrid(np.linspace(-1, 1, nodes) * spread[0], np.linspace(1, -1, nodes) * spread[1])
        seed, scale = new_seed(rng), between(rng, 0.8, 5)
        flat = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        # A float64, which NumPy before 2 and since then multiply float32 by in different precision.
        steepness = between(rng, 0.01, 0.12) / np.sqrt(scale)
        height = steepness * fractal_noise(flat * scale, seed, 3).astype(np.float64).reshape(x.shape)
        front = np.stack([x, y, height], axis=-1)
        return placed(sheet(front, np.stack([x, y, np.full_like(x, -0.25)], axis=-1), part), offset=(*middle, 0))
    angles = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    power = picked(rng, (1.0, 0.35))
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    outline = np.sign(circle) * np.abs(circle) ** power * spread * (1.1 if power == 1 else 1.0)
    return placed(slab(outline, 0.16, 0.03, part), offset=(*middle, -0.16))
