"""Drapery: cloth hanging from pins, in pleats, draped over hidden objects, or crumpled."""

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.noise import fractal_noise, gradient_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, integer, new_seed, uniform
from mpsnet_core.synthesis.shapes.isosurface import Solid, blended, box, cylinder, ellipsoid, lengths, limb
from mpsnet_core.synthesis.shapes.shape import Shape, catmull_rom, sheet, turn_about

CHARACTERS = ("draped", "pinned", "pleated", "crumpled")
# Nodes along a side of the simulated cloth, coarse to fine, and number of steps at each level.
_LEVELS = ((15, 60), (29, 40), (57, 18))
_REPEATS = 4
_REFINED = 2
# Acceleration per step squared, small enough that no step passes through a solid.
_GRAVITY = 0.0035
_THICKNESS = 0.02


def build_drapery(character: str, rng: np.random.Generator) -> Shape:
    """Cloth of this character, about 2 wide: "draped" has z up, the others face +z."""
    if character == "pleated":
        return _pleated(rng)
    if character == "crumpled":
        return _crumpled(rng)
    if character == "draped":
        solids, size = _hidden(rng)
        start = _flat(_LEVELS[0][0], size)
        top = max(float(solid.centre[2] + solid.half[2]) for solid in solids)
        start = start @ _turned(rng) + (uniform(rng, -0.2, 0.2), uniform(rng, -0.2, 0.2), top + 0.1)
        cloth = _simulated(start, size, solids, {}, new_seed(rng))
    else:
        size = uniform(rng, 1.8, 2.6)
        start, pins = _hung(rng, size)
        cloth = _simulated(start, size, [], pins, new_seed(rng)) @ np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)])
    return _finished(cloth, rng)


def hammock(rng: np.random.Generator) -> Shape:
    """Cloth that sags between its corners or two of its sides, as if held by hands, open towards +z."""
    nodes, size = _LEVELS[0][0], uniform(rng, 1.8, 2.6)
    start, last = _flat(nodes, size), nodes - 1
    start[..., 0] *= uniform(rng, 0.4, 0.85)
    start[..., 2] = size
    side = range(0, nodes, 2) if chance(rng, 0.3) else (0, last)
    held = [(row, column) for column in (0, last) for row in side]
    gather = uniform(rng, 0.5, 0.95)
    pins = {place: start[place] * (1, gather, 1) + (0, 0, uniform(rng, -0.3, 0.3)) for place in held}
    start[..., 1] *= gather
    cloth = _simulated(start, size, [], pins, new_seed(rng))
    return _finished(cloth - cloth.mean(axis=(0, 1)), rng)


def _turned(rng: np.random.Generator) -> F64:
    """Axes rotated about z by a random angle."""
    return turn_about((0, 0, 1), uniform(rng, 0, 360))


def _hidden(rng: np.random.Generator) -> tuple[list[Solid], float]:
    """Solids under the cloth, standing on z = 0, and the cloth's size."""
    solids: list[Solid] = []
    for _ in range(integer(rng, 1, 4)):
        x, y = (uniform(rng, -0.5, 0.5) * (len(solids) > 0) for _ in range(2))
        high = uniform(rng, 0.3, 1.2)
        kind = choice(rng, ("ball", "box", "cylinder", "pole"))
        if kind == "ball":
            r = uniform(rng, 0.3, 0.6)
            solids.append(ellipsoid((x, y, r), r))
        elif kind == "box":
            half = np.array([uniform(rng, 0.25, 0.6), uniform(rng, 0.25, 0.6), high / 2])
            solids.append(box((x, y, high / 2), half, 0.03, _turned(rng)))
        elif kind == "cylinder":
            solids.append(cylinder((x, y, high / 2), uniform(rng, 0.15, 0.5), high / 2, 0.03))
        else:
            solids.append(limb((x, y, 0), (x, y, 1.2 * high), 0.2, uniform(rng, 0.08, 0.2)))
    return solids, uniform(rng, 1.6, 2.5)


def _hung(rng: np.random.Generator, size: float) -> tuple[F64, dict[tuple[int, int], F64]]:
    """A cloth in the x, z plane, with its first row on top, and the pins that gather it."""
    nodes = _LEVELS[0][0]
    flat = _flat(nodes, size)
    start = np.stack([flat[..., 0], np.zeros((nodes, nodes)), flat[..., 1]], axis=-1)
    places = sorted({0, nodes - 1, *(integer(rng, 2, nodes - 3) for _ in range(integer(rng, 0, 2)))})
    gather = uniform(rng, 0.35, 0.8)
    pins = {}
    for place in places:
        x, _, z = start[0, place]
        pins[0, place] = np.array([x * gather, uniform(rng, -0.15, 0.15), z + uniform(rng, -0.3, 0.1)])
    if chance(rng, 0.3):  # held in the middle, as by a hand
        pins[nodes // 2, nodes // 2] = np.array([uniform(rng, -0.2, 0.2), -0.3, size * uniform(rng, 0.1, 0.35)])
    start[..., 0] *= gather
    return start, pins


def _flat(nodes: int, size: float) -> F64:
    """A square grid (nodes, nodes, 3) in the x, y plane, facing +z; rows are in descending order of y."""
    steps = np.linspace(-size / 2, size / 2, nodes)
    x, y = np.meshgrid(steps, -steps)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def _simulated(start: F64, size: float, solids: list[Solid], pins: dict[tuple[int, int], F64], seed: int) -> F64:
    """The settled cloth (M, M, 3), by position-based dynamics (Müller et al. 2007) on successively finer grids.

    Distance constraints: edges, diagonals and, weakly, every second node. Long-range attachments limit the distance of
    nodes from pins (Kim et al. 2012). The cloth collides with solids and with the ground at z = 0.
    """
    grid = start
    for nodes, steps in _LEVELS:
        grid = _resampled(grid, nodes)
        rest = size / (nodes - 1)
        # A small perturbation lets it buckle.
        unrest = [gradient_noise(grid.reshape(-1, 3) * 3, seed + k).reshape(nodes, nodes) for k in range(3)]
        cloth: F64 = np.moveaxis(grid, 2, 0) + 0.1 * rest * np.stack(unrest)
        scale = (nodes - 1) // (_LEVELS[0][0] - 1)
        held = [(row * scale, column * scale, at[:, None, None]) for (row, column), at in pins.items()]
        rows, columns = np.indices((nodes, nodes))
        reaches = [rest * np.sqrt((rows - row) ** 2 + (columns - column) ** 2) for row, column, _ in held]
        before = cloth.copy()
        for _ in range(steps):
            before, cloth = cloth, _fallen(cloth, before)
            for _ in range(_REPEATS):
                _constrain_lengths(cloth, rest)
                for row, column, at in held:
                    cloth[:, row, column] = at[:, 0, 0]
            for (_, _, at), reach in zip(held, reaches, strict=True):
                apart = cloth - at
                cloth -= apart * (1 - np.minimum(1, reach / np.maximum(lengths(apart), 1e-9)))
            if solids:
                _push_out(cloth.reshape(3, -1), before.reshape(3, -1), solids)
        grid = np.moveaxis(cloth, 0, 2)
    return grid


def _fallen(cloth: F64, before: F64) -> F64:
    moved: F64 = cloth + 0.93 * (cloth - before)
    moved[2] -= _GRAVITY
    return moved


def _constrain_lengths(cloth: F64, rest: float) -> None:
    # Alternate pairs, so no node is moved twice at a time.
    for grid in (cloth, cloth.transpose(0, 2, 1)):
        for odd in (0, 1):
            end = (grid.shape[1] - odd) // 2 * 2 + odd
            near, far = grid[:, odd:end:2], grid[:, odd + 1 : end : 2]
            _pull(near, far, rest, 0.5)
            _pull(near[..., :-1], far[..., 1:], rest * 2**0.5, 0.15)
            _pull(near[..., 1:], far[..., :-1], rest * 2**0.5, 0.15)
        _pull(grid[:, :-2], grid[:, 2:], 2 * rest, 0.04)


def _pull(a: F64, b: F64, rest: float, share: float) -> None:
    apart = b - a
    apart *= share * (1 - rest / np.maximum(lengths(apart), 1e-9))
    a += apart
    b -= apart


def _push_out(points: F64, before: F64, solids: list[Solid]) -> None:
    """Project points (3, N) inside a solid or the ground onto its surface, in place, with strong friction."""

    def distance(places: F64) -> F64:
        total: F64 = places[2]
        for solid in solids:
            total = blended(total, solid.signed_distance(places), 0.05)
        return total - 0.03

    inside = np.flatnonzero(distance(points) < 0)
    places = points[:, inside]
    depth = distance(places)
    gradient = np.stack([distance(places + step[:, None]) - depth for step in 1e-3 * np.eye(3)])
    points[:, inside] -= depth * gradient / np.maximum(lengths(gradient), 1e-9)
    before[:, inside] += 0.7 * (points[:, inside] - before[:, inside])


def _resampled(grid: F64, nodes: int) -> F64:
    """A grid (M, M, 3) resampled to `nodes` nodes along a side, by cubic interpolation."""
    if len(grid) == nodes:
        return grid
    for axis in (0, 1):
        grid = np.moveaxis(catmull_rom(np.moveaxis(grid, axis, 0), nodes), 0, axis)
    return np.ascontiguousarray(grid)


def _finished(cloth: F64, rng: np.random.Generator) -> Shape:
    """The cloth as a closed shape: refined, with fine creases and a back."""
    front = _resampled(cloth, _REFINED * (len(cloth) - 1) + 1)
    normals = _grid_normals(front)
    if chance(rng, 0.5):
        rows = np.indices(front.shape[:2]).reshape(2, -1).T / len(front)
        flat = np.column_stack([rows * uniform(rng, 8, 20) * (uniform(rng, 0.4, 1), 1), np.zeros(len(rows))])
        height = uniform(rng, 0.004, 0.012) * fractal_noise(flat, new_seed(rng), 2)
        front = front + height.reshape(*front.shape[:2], 1) * normals
        normals = _grid_normals(front)
    return sheet(front, front - _THICKNESS * normals)


def _grid_normals(grid: F64) -> F64:
    return normalised(np.cross(np.gradient(grid, axis=1), -np.gradient(grid, axis=0)))


def _pleated(rng: np.random.Generator) -> Shape:
    """A curtain facing +z, with pleats that wander, sag, overhang and merge on their way down."""
    nodes, tall = 180, uniform(rng, 0.7, 1.4)
    x, y = np.meshgrid(np.linspace(-1, 1, nodes), np.linspace(1, -1, nodes))
    seed, down = new_seed(rng), (1 - y) / 2
    flat = np.stack([x, y * tall, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    drift = fractal_noise(flat * (1.2, uniform(rng, 0.3, 1.0), 1), seed, 2).reshape(x.shape)
    pleats, wander = uniform(rng, 2, 6), uniform(rng, 0.2, 0.9)
    phase = pleats * x / 2 + wander * drift + uniform(rng, -0.4, 0.4) * y + uniform(rng, 0, 0.5) * x * x * y
    phase *= 2 * np.pi
    strength = 0.65 + 0.8 * gradient_noise(flat * (1.6, 1.0, 1), seed + 9).reshape(x.shape)
    strength = np.clip(strength, 0.05, 1.4) * (uniform(rng, 0.4, 1.0) + uniform(rng, 0, 0.8) * down)
    merged = np.clip(1.4 * down + 0.3 * drift, 0, 1) if chance(rng, 0.6) else np.ones_like(x)
    wave = merged * np.sin(phase) + (1 - merged) * 0.6 * np.sin(2 * phase) + 0.2 * merged * np.sin(2 * phase + 1.3)
    deep, over = uniform(rng, 0.1, 0.3) / pleats**0.5, uniform(rng, 0.0, 0.16) / pleats
    gather = 1 - uniform(rng, 0, 0.5) * (1 - down) ** 2
    hem = 0.1 * gradient_noise(flat * (1.5, 0, 0), seed + 4).reshape(x.shape) * down
    across = (x + over * strength * np.sin(2 * phase)) * gather
    front = np.stack([across, y * tall + hem, deep * strength * wave], axis=-1)
    front[..., 2] += 0.25 * gradient_noise(flat * 1.1, seed + 5).reshape(x.shape)
    normals = _grid_normals(front)
    fine = fractal_noise(flat * (9, uniform(rng, 5, 14), 1), seed + 3, 2).reshape(*x.shape, 1)
    front = front + uniform(rng, 0, 0.012) * fine * normals
    if chance(rng, 0.5):
        return sheet(front, front - _THICKNESS * normals)
    front[..., 2] -= front[..., 2].min() - 0.05
    return sheet(front, front * (1, 1, 0))


def _crumpled(rng: np.random.Generator) -> Shape:
    """A sheet facing +z, with many straight creases of all sizes, distorted by noise."""
    nodes = 150
    x, y = np.meshgrid(np.linspace(-1, 1, nodes), np.linspace(1, -1, nodes))
    seed = new_seed(rng)
    flat = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    warp = uniform(rng, 0.02, 0.25)
    bent = flat + warp * np.stack([gradient_noise(flat * 1.5, seed + k) for k in range(3)], axis=1)
    height, sharp = np.zeros(len(flat)), uniform(rng, 0.005, 0.03)
    for k in range(integer(rng, 14, 40)):
        size = uniform(rng, 0.15, 1.0)
        angle, shift = uniform(rng, 0, 2 * np.pi), uniform(rng, -1, 1)
        across = np.cos(angle) * bent[:, 0] + np.sin(angle) * bent[:, 1] - shift
        # Noise fades each crease out.
        weight = np.clip(0.5 + 1.5 * gradient_noise(flat * (1.2 / size), seed + 20 + k), 0, 1)
        fold = np.sqrt(across**2 + (sharp * size) ** 2)
        height += weight * choice(rng, (-1, 1)) * uniform(rng, 0.15, 0.45) * np.minimum(fold, 0.4 * size)
    height += 0.25 * gradient_noise(flat * uniform(rng, 0.6, 1.3), seed + 11)
    push = 0.06 * np.stack([gradient_noise(flat * 2.5, seed + 60 + k) for k in range(2)], axis=1)
    front = np.column_stack([flat[:, :2] + push, height]).reshape(nodes, nodes, 3)
    front[..., 2] -= front[..., 2].min() - 0.05
    back = np.stack([front[..., 0], front[..., 1], np.zeros_like(x)], axis=-1)
    return sheet(front, back)
