"""Reliefs: plates with letters, figures, ornaments, hills or a head, as on a coin."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.synthesis.noise import fractal_noise, gradient_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, integer, new_seed, uniform
from mpsnet_core.synthesis.shapes.isosurface import blended
from mpsnet_core.synthesis.shapes.shape import Shape, catmull_rom, sheet

# A motif: a height field, 0 to about 1, of x, y (N,), about 2 wide.
Motif = Callable[[F64, F64], F64]

_NODES = 160


def build_relief(character: str, rng: np.random.Generator) -> Shape:
    """A relief of this character, facing +z, about 2 wide."""
    x, y = np.meshgrid(np.linspace(-1, 1, _NODES), np.linspace(1, -1, _NODES))
    disc = character == "coin" or chance(rng, 0.25)
    if disc:  # smooth map from the square to a disc
        x, y = x * np.sqrt(1 - y * y / 2), y * np.sqrt(1 - x * x / 2)
    u, v = x.ravel(), y.ravel()
    seed = new_seed(rng)
    flat: F64 = np.column_stack([u, v, np.zeros_like(u)])
    # A slight distortion: no stroke is perfectly straight.
    bend = uniform(rng, 0.0, 0.04)
    places = (axis + bend * gradient_noise(flat * 2, seed + k) for k, axis in enumerate((u, v)))
    height = uniform(rng, 0.1, 0.3) * _MOTIFS[character](rng)(*places)
    edge = 0.97 - (np.sqrt(u * u + v * v) if disc else np.maximum(np.abs(u), np.abs(v)))
    if disc or chance(rng, 0.5):
        rim = uniform(rng, 0.03, 0.07)
        height = height * _step(edge - rim, rim) + uniform(rng, 0.05, 0.12) * _bump(edge, rim)
    worn = uniform(rng, 0.0, 0.02) * fractal_noise(flat * uniform(rng, 3, 12), seed + 5, 3)
    height = height + worn + uniform(rng, -0.15, 0.15) * (u * u + v * v) + 0.05 * gradient_noise(flat * 1.3, seed + 8)
    front = np.stack([x, y, _softened(height.reshape(x.shape)) - height.min() + 0.12], axis=-1)
    if not disc:
        front[..., 1] *= uniform(rng, 0.7, 1.0)
    return sheet(front, front * (1, 1, 0))


def _softened(height: F64) -> F64:
    """Smooth steps that the grid cannot resolve."""
    for _ in range(2):
        for axis in (0, 1):
            rows = np.pad(np.moveaxis(height, axis, 0), ((1, 1), (0, 0)), mode="edge")
            height = np.moveaxis((rows[:-2] + 2 * rows[1:-1] + rows[2:]) / 4, 0, axis)
    return height


def _coin(rng: np.random.Generator) -> Motif:
    """A head in profile or from the front, with an inscription of short strokes around it."""
    turn = choice(rng, (-1, 1))
    lumps = [
        (0.0, 0.12, 0.36, 0.42, 0.9),  # skull
        (0.14, -0.12, 0.24, 0.3, 0.8),  # jaw
        (0.33, uniform(rng, -0.05, 0.08), 0.1, 0.13, 0.8),  # nose
        (0.28, -0.2, 0.08, 0.05, 0.8),
        (0.26, -0.32, 0.1, 0.09, 0.8),  # chin
        (-0.1, -0.45, 0.2, 0.35, 0.7),  # neck
        (-0.15, -0.75, 0.5, 0.22, 0.75),  # shoulders
        (-0.16, 0.25, uniform(rng, 0.28, 0.4), uniform(rng, 0.25, 0.4), 1.1),  # hair
        (-0.08, 0.0, 0.06, 0.1, 1.2),  # ear
        (uniform(rng, -0.5, -0.3), uniform(rng, -0.3, 0.1), 0.14, 0.2, 0.9),
    ]
    rays = integer(rng, 18, 50)
    marks = [(2 * np.pi * k / rays, uniform(rng, 0.02, 0.06), chance(rng, 0.75)) for k in range(rays)]
    seed = new_seed(rng)

    def height(u: F64, v: F64) -> F64:
        total = np.zeros_like(u)
        for x, y, wide, high, tall in lumps:
            total = _soft_max(total, _lens((turn * u - x) / wide, (v - y) / high, 0.35) * tall, 0.08)
        points = np.column_stack([u * 9, v * 5, np.zeros_like(u)])
        hair = _lens((turn * u + 0.16) / 0.36, (v - 0.25) / 0.36, 0.3)
        total += 0.12 * hair * gradient_noise(points, seed)
        for angle, long, drawn in marks:
            if drawn:
                a, b = 0.78 - long, 0.78 + long
                path = [(r * np.cos(turned), r * np.sin(turned)) for r, turned in ((a, angle), (b, angle + 0.04))]
                total = np.maximum(total, 0.5 * _stroke(u, v, np.array(path), 0.022))
        return total

    return height


def _letters(rng: np.random.Generator) -> Motif:
    """Rows of glyphs, each with a few strokes, raised or engraved, round or chiselled."""
    rows = integer(rng, 1, 4)
    columns = rows + integer(rng, 1, 4)
    thick = uniform(rng, 0.09, 0.16)
    sign = choice(rng, (1, 1, -1))
    cell = np.array([1.7 / columns, 1.7 / rows])
    strokes = []
    knots = [(0, 0), (0.5, 0), (1, 0), (0, 0.5), (1, 0.5), (0, 1), (0.5, 1), (1, 1), (0.5, 0.5)]
    for row in range(rows):
        for column in range(columns):
            corner = np.array([-0.85 + column * cell[0], -0.85 + row * cell[1]]) + 0.15 * cell
            for _ in range(integer(rng, 1, 3)):
                path = np.array([knots[int(rng.integers(len(knots)))] for _ in range(integer(rng, 2, 4))], np.float64)
                path = corner + path * cell * 0.7
                rounded = chance(rng, 0.5) and len(path) > 2
                strokes.append(catmull_rom(path, 6 * (len(path) - 1) + 1) if rounded else path)
    width = thick * float(cell.min())

    def height(u: F64, v: F64) -> F64:
        total = np.zeros_like(u)
        for path in strokes:
            total = np.maximum(total, _stroke(u, v, path, width))
        return sign * total

    return height


def _ornament(rng: np.random.Generator) -> Motif:
    """A rosette or a repeating pattern of leaves, petals, spirals and beads."""
    turns = integer(rng, 3, 10)
    parts = []
    for _ in range(integer(rng, 3, 7)):
        away, size = uniform(rng, 0.2, 0.85), uniform(rng, 0.12, 0.35)
        kind = choice(rng, ("petal", "bead", "arc", "spiral"))
        parts.append((kind, away, size, uniform(rng, 0.4, 1.0), uniform(rng, -0.5, 0.5)))
    across = chance(rng, 0.35)
    repeat = integer(rng, 2, 3)

    def height(u: F64, v: F64) -> F64:
        if across:
            u, v = (np.abs((axis * repeat / 2 + 0.5) % 1 * 2 - 1) * 2 - 1 for axis in (u, v))
        away, angle = np.sqrt(u * u + v * v), np.arctan2(v, u)
        sector = 2 * np.pi / turns
        folded = (angle / sector + 0.5) % 1 - 0.5
        total = np.zeros_like(u)
        for kind, radius, size, tall, lean in parts:
            mirrored = np.abs(folded) if lean > 0 else folded
            x, y = away * np.cos(mirrored * sector) - radius, away * np.sin(mirrored * sector) - lean * 0.2 * (lean > 0)
            if kind == "petal":
                shape = _lens(x / (1.3 * size), y / (0.5 * size), 0.4)
                shape = shape * (1 - 0.5 * _bump(y, 0.12 * size))
            elif kind == "bead":
                shape = _lens(x / (0.5 * size), y / (0.5 * size), 0.3)
            elif kind == "arc":
                shape = _bump(away - radius, 0.25 * size)
            else:
                pitch = max(0.4 * size, 0.12)
                turn = np.arctan2(y, x)
                distance = np.sqrt(x * x + y * y)
                coil: F64 = np.abs((distance / pitch - turn / (2 * np.pi)) % 1 - 0.5)
                shape = _step(size - distance, 0.3 * size) * _step(coil - 0.18, 0.15)
            total = np.maximum(total, tall * shape)
        return total / repeat if across else total

    return height


def _figures(rng: np.random.Generator) -> Motif:
    """Animals and people with rounded limbs, overlapping."""
    limbs = []
    for k in range(integer(rng, 2, 5)):
        size = uniform(rng, 0.5, 0.85)
        x, y = uniform(rng, -0.55, 0.55), uniform(rng, -0.25, 0.15)
        tall = uniform(rng, 0.6, 1.1)
        turn = choice(rng, (-1, 1))
        if chance(rng, 0.5):  # an animal from the side
            bones = [((-0.6, 0.1), (0.5, 0.15), 0.3), ((0.5, 0.2), (0.8, 0.65), 0.18), ((0.8, 0.65), (1.1, 0.55), 0.16)]
            bones += [((s, 0.0), (s + uniform(rng, -0.2, 0.2), -0.85), 0.1) for s in (-0.6, -0.4, 0.35, 0.55)]
            bones += [((-0.7, 0.2), (-1.1, uniform(rng, -0.3, 0.6)), 0.06), ((0.75, 0.75), (0.65, 1.05), 0.07)]
        else:  # a person
            bones = [((0, -0.1), (0.05, 0.45), 0.26), ((0.05, 0.85), (0.07, 0.9), 0.2)]
            bones += [((0.1 * s, -0.1), (0.25 * s + uniform(rng, -0.2, 0.2), -0.95), 0.12) for s in (-1, 1)]
            for s in (-1, 1):
                elbow = (0.45 * s + 0.05, uniform(rng, 0.0, 0.5))
                hand = (elbow[0] + uniform(rng, -0.4, 0.4), elbow[1] + uniform(rng, -0.3, 0.5))
                bones += [((0.22 * s, 0.5), elbow, 0.09), (elbow, hand, 0.08)]
        limbs.append((x, y, size, tall * (1 - 0.12 * k), turn, bones))

    def height(u: F64, v: F64) -> F64:
        total = np.zeros_like(u)
        for x, y, size, tall, turn, bones in limbs:
            figure = np.zeros_like(u)
            for a, b, thick in bones:
                path = np.array([(turn * a[0], a[1]), (turn * b[0], b[1])]) * size + (x, y)
                figure = _soft_max(figure, _stroke(u, v, path, thick * size) * (0.4 + 2.2 * thick), 0.06)
            total = _soft_max(total, tall * figure, 0.03)
        return total

    return height


def _landscape(rng: np.random.Generator) -> Motif:
    """Hills and terraces of noise."""
    seed, scale = new_seed(rng), uniform(rng, 1.2, 3.0)
    steps = choice(rng, (0, 3, 5, 8))

    def height(u: F64, v: F64) -> F64:
        points = np.column_stack([u * scale, v * scale, np.full_like(u, 0.37)])
        field = 0.5 + 0.8 * fractal_noise(points, seed, 3).astype(np.float64)
        if steps:
            level = np.floor(field * steps)
            field = (level + _smooth(np.clip((field * steps - level) * 3, 0, 1))) / steps
        return field

    return height


def _smooth(t: F64) -> F64:
    return t * t * (3 - 2 * t)


def _step(distance: F64, width: float) -> F64:
    """Smooth step from 0 at 0 to 1 at `width`."""
    return _smooth(np.clip(distance / width, 0, 1))


def _bump(distance: F64, width: float) -> F64:
    """A round ridge, 1 at 0 and 0 beyond `width`."""
    return _smooth(np.clip(1 - np.abs(distance) / width, 0, 1))


def _lens(x: F64, y: F64, rim: float) -> F64:
    """A pillow over the unit disc: a steep rim of width `rim`, then domed."""
    away: F64 = np.sqrt(x * x + y * y)
    return _step(1.0 - away, rim) * (1 - 0.35 * np.minimum(away, 1) ** 2)


def _stroke(u: F64, v: F64, path: F64, width: float) -> F64:
    """A round ridge along a path (M, 2)."""
    low, high = path.min(axis=0) - width, path.max(axis=0) + width
    near = np.flatnonzero((u > low[0]) & (u < high[0]) & (v > low[1]) & (v < high[1]))
    x, y = u[near], v[near]
    nearest = np.full_like(x, 9.0)
    for a, b in pairwise(path):
        along = b - a
        t = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / max(float(along @ along), 1e-9), 0, 1)
        nearest = np.minimum(nearest, (x - a[0] - t * along[0]) ** 2 + (y - a[1] - t * along[1]) ** 2)
    height = np.zeros_like(u)
    height[near] = _smooth(np.clip(1.6 * (1 - np.sqrt(nearest) / width), 0, 1))
    return height


def _soft_max(a: F64, b: F64, width: float) -> F64:
    return -blended(-a, -b, width)


_MOTIFS: dict[str, Callable[[np.random.Generator], Motif]] = {
    "coin": _coin,
    "letters": _letters,
    "ornament": _ornament,
    "figures": _figures,
    "landscape": _landscape,
}
CHARACTERS = tuple(_MOTIFS)
