"""Blobs: closed bodies of one part, smooth, hollowed, folded, ridged, finely wrinkled or faceted."""

from collections.abc import Callable, Sequence

import numpy as np

from mpsnet_core.arrays.types import F64, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.noise import fractal_noise, gradient_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, direction, integer, new_seed, rotation, uniform
from mpsnet_core.synthesis.shapes import shape
from mpsnet_core.synthesis.shapes.isosurface import ellipsoid, isosurface, limb

CHARACTERS = ("smooth", "hollowed", "folded", "ridged", "wrinkled", "faceted")


def build_blob(character: str, rng: np.random.Generator, cells: int) -> shape.Shape:
    """A blob of this character, about 2 wide. cells: resolution of the grid for implicit surfaces."""
    if character == "faceted":
        return _faceted(rng)
    if character == "smooth":
        return _body(rng, cells)
    if character == "hollowed":
        return _hollowed(rng, cells)
    if character == "folded":
        return shape.bent(_ball(cells), _folds(rng))
    if character == "ridged":
        return shape.displaced(_body(rng, cells), _ridges(rng))
    return shape.displaced(_body(rng, cells), _wrinkles(rng))


def _ball(cells: int) -> shape.Shape:
    vertices, triangles = shape.sphere(6 if cells > 64 else 5)
    return shape.smooth_shape(vertices, triangles, vertices)


def _body(rng: np.random.Generator, cells: int) -> shape.Shape:
    """Blended lumps, or a ball with bumps and dents."""
    if chance(rng, 0.5):
        soft = uniform(rng, 0.1, 0.6)
        solids = []
        for _ in range(integer(rng, 3, 9)):
            place = direction(rng) * uniform(rng, 0.2, 0.9)
            if chance(rng, 0.6):
                radii = np.array([uniform(rng, 0.2, 0.65) for _ in range(3)])
                solids.append(ellipsoid(place, radii, rotation(rng), blend=soft))
            else:
                end = direction(rng) * uniform(rng, 0.5, 1.1)
                solids.append(limb(place, end, uniform(rng, 0.15, 0.4), uniform(rng, 0.1, 0.35), blend=soft))
        solids.append(ellipsoid((0, 0, 0), uniform(rng, 0.3, 0.6), blend=soft))
        return isosurface(solids, 2.2 / cells)
    seed, scale = new_seed(rng), uniform(rng, 0.8, 1.8)
    swell, push = uniform(rng, 0.15, 0.45), uniform(rng, 0.1, 0.25)
    stretch = np.array([uniform(rng, 0.6, 1.1) for _ in range(3)])

    def form(points: F64) -> F64:
        out = 1 + swell * fractal_noise(points * scale, seed, 2)
        return (points * out[:, None] + push * _vectors(points * 1.1, seed + 1)) * stretch

    return shape.bent(_ball(cells), form)


def _hollowed(rng: np.random.Generator, cells: int) -> shape.Shape:
    """A few lumps with deep bowls, holes and gaps open towards +z, where few lights reach and bounces matter."""
    soft = uniform(rng, 0.05, 0.4)
    solids = [ellipsoid((0, 0, 0), [uniform(rng, 0.6, 1.0) for _ in range(3)], rotation(rng), blend=soft)]
    for _ in range(integer(rng, 0, 4)):
        radii = [uniform(rng, 0.25, 0.6) for _ in range(3)]
        solids.append(ellipsoid(direction(rng) * uniform(rng, 0.3, 0.9), radii, rotation(rng), blend=soft))
    for _ in range(integer(rng, 1, 4)):
        towards = normalised(direction(rng) * 0.9 + np.array([0.0, 0.0, 1.0]))
        aside = uniform(rng, 0.0, 0.5) * direction(rng) * [1, 1, 0]
        edge, radius = uniform(rng, 0.01, 0.15), uniform(rng, 0.15, 0.5)
        if chance(rng, 0.5):
            radii = [radius * uniform(rng, 0.6, 1.6) for _ in range(3)]
            mouth = aside + towards * uniform(rng, 0.4, 0.8)
            solids.append(ellipsoid(mouth, radii, rotation(rng), blend=edge, carve=True))
        else:
            deep = aside + towards * uniform(rng, -0.2, 0.4)
            solids.append(limb(deep, aside + towards * 1.4, radius * 0.6, radius, blend=edge, carve=True))
    return isosurface(solids, 2.2 / cells)


def _folds(rng: np.random.Generator) -> Callable[[F64], F64]:
    """Deep folds: bulges separated by creases, distorted by noise."""
    seed, scale = new_seed(rng), uniform(rng, 1.3, 2.6)
    depth, warp, push = uniform(rng, 0.5, 1.0), uniform(rng, 0.1, 0.5), uniform(rng, 0.1, 0.4)
    stretch = np.array([uniform(rng, 0.35, 1.2) for _ in range(3)])
    sharp = uniform(rng, 0.002, 0.02)

    def form(points: F64) -> F64:
        places = (points + warp * _vectors(points * 1.5, seed)) * stretch * scale
        bulge = np.sqrt(gradient_noise(places, seed + 3) ** 2 + sharp)
        fine = 0.35 * np.sqrt(gradient_noise(places * 2.1, seed + 4) ** 2 + sharp)
        out = 0.7 + depth * (bulge + fine)
        return points * out[:, None] + push * _vectors(points * 0.9, seed + 5)

    return form


def _ridges(rng: np.random.Generator) -> Callable[[F64], F64]:
    """Sharp ridges between smooth valleys."""
    seed, scale, amount = new_seed(rng), uniform(rng, 1.3, 2.8), uniform(rng, 0.05, 0.12)
    sharp, warp = uniform(rng, 0.002, 0.01), uniform(rng, 0.0, 0.3)

    def height(points: F64) -> F64:
        places = (points + warp * _vectors(points * 1.3, seed)) * scale
        crest = 0.5 - np.sqrt(gradient_noise(places, seed + 3) ** 2 + sharp)
        finer = 0.5 - np.sqrt(gradient_noise(places * 2.2, seed + 4) ** 2 + sharp)
        return amount * (2 * crest + 1.2 * crest * finer - 0.6)

    return height


def _wrinkles(rng: np.random.Generator) -> Callable[[F64], Floats]:
    """Fine relief: creases, grain, or ridges like those of a fingerprint or a brain."""
    kind = choice(rng, ("creases", "grain", "rows"))
    seed = new_seed(rng)
    stretch = np.array([uniform(rng, 0.25, 1.0) for _ in range(3)])
    if kind == "creases":
        scale, amount = uniform(rng, 4, 9), uniform(rng, 0.02, 0.05)
        return lambda p: amount * np.sqrt(fractal_noise(p * stretch * scale, seed, 2) ** 2 + 0.004)
    if kind == "grain":
        scale, amount = uniform(rng, 8, 22), uniform(rng, 0.05, 0.14)
        return lambda p: amount / scale * 3 * fractal_noise(p * scale, seed, 2)
    rows, scale, amount = uniform(rng, 12, 26), uniform(rng, 0.8, 1.8), uniform(rng, 0.012, 0.03)
    return lambda p: amount * np.sin(rows * gradient_noise(p * stretch * scale, seed).astype(np.float64))


def _faceted(rng: np.random.Generator) -> shape.Shape:
    kind = choice(rng, ("gem", "rough", "crystals"))
    if kind == "rough":
        vertices, triangles = shape.sphere(integer(rng, 1, 4))
        seed, scale, swell = new_seed(rng), uniform(rng, 0.9, 2.2), uniform(rng, 0.3, 0.8)
        stretch = np.array([uniform(rng, 0.6, 1.1) for _ in range(3)])
        out = 1 + swell * fractal_noise(vertices * scale, seed, 2)
        moved = (vertices * out[:, None] + 0.3 * _vectors(vertices, seed + 1)) * stretch
        return shape.faceted_shape(moved, triangles)
    if kind == "gem":
        vertices, triangles = shape.sphere(6)
        faces = normalised(rng.normal(size=(integer(rng, 9, 40), 3)) * [uniform(rng, 0.6, 1.4) for _ in range(3)])
        away = np.array([uniform(rng, 0.75, 1.1) for _ in faces])
        # The convex body of the planes, with six distant planes that keep it bounded.
        faces = np.concatenate([faces, np.eye(3), -np.eye(3)])
        away = np.concatenate([away, np.full(6, 1.3)])
        return shape.faceted_shape(vertices / (vertices @ faces.T / away).max(axis=1)[:, None], triangles)
    crystals = shape.joined([_crystal(rng) for _ in range(integer(rng, 7, 16))])
    return shape.faceted_shape(crystals.vertices, crystals.triangles)


def _crystal(rng: np.random.Generator) -> shape.Shape:
    """A pointed prism that starts at the origin."""
    sides, wide, long = integer(rng, 4, 6), uniform(rng, 0.12, 0.32), uniform(rng, 0.5, 1.2)
    turns = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    outline = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(sides)]) * wide
    cut = uniform(rng, 0.05, 0.9) * wide
    up = np.array([0.0, 0.0, 1.0])
    rings = [outline - 0.1 * up, outline + long * up, 0.02 * outline + (long + cut) * up]
    return shape.placed(shape.stacked(np.stack(rings)), rotation(rng))


def _vectors(points: F64, seed: int) -> F64:
    return np.stack([gradient_noise(points, seed + 7 * k) for k in range(3)], axis=1)


# --- groups: several objects next to each other on a ground -----------------------------------------------------------


def build_group(rng: np.random.Generator, cells: int) -> shape.Shape:
    """Two to four blobs on a ground, z up."""
    blobs = [shape.fitted(build_blob(choice(rng, CHARACTERS), rng, cells)) for _ in range(integer(rng, 2, 4))]
    return on_ground([shape.placed(blob, rotation(rng)) for blob in blobs], rng)


def on_ground(objects: Sequence[shape.Shape], rng: np.random.Generator) -> shape.Shape:
    """Objects of radius 1, randomly rotated about z and scaled, close together on a ground; each is a part."""
    spots: list[tuple[float, float, float]] = []
    pieces = []
    for item in objects:
        scale = uniform(rng, 0.45, 1.0)
        item = shape.standing(shape.placed(item, shape.turn_about((0, 0, 1), uniform(rng, 0, 360)), scale))
        middle = (item.vertices[:, :2].min(axis=0) + item.vertices[:, :2].max(axis=0)) / 2
        radius = 0.9 * float(np.sqrt(((item.vertices[:, :2] - middle) ** 2).sum(axis=1).max()))
        x, y = _free_spot(rng, spots, radius)
        spots.append((x, y, radius))
        pieces.append(shape.placed(item, offset=(x - middle[0], y - middle[1], uniform(rng, -0.06, 0.0))))
    return shape.joined([*pieces, _ground(rng, np.concatenate([piece.vertices[:, :2] for piece in pieces]))])


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


def _ground(rng: np.random.Generator, footprint: F64) -> shape.Shape:
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
        return shape.placed(shape.sheet(front, np.stack([x, y, np.full_like(x, -0.25)], axis=-1)), offset=(*middle, 0))
    angles = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    power = choice(rng, (1.0, 0.35))
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    outline = np.sign(circle) * np.abs(circle) ** power * spread * (1.1 if power == 1 else 1.0)
    return shape.placed(shape.slab(outline, 0.16, 0.03), offset=(*middle, -0.16))
