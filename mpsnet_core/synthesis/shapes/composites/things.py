"""Things: what is worn and carried: hats, sacks, boxes, balls, baskets, books, drums."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.synthesis.noise import gradient_noise
from mpsnet_core.synthesis.shapes.composites.assembly import BASE, DRESS, FEATURES, LOAD, Piece
from mpsnet_core.synthesis.shapes.draws import between, chance, count, direction, new_seed, picked, turned
from mpsnet_core.synthesis.shapes.shape import Shape, joined, placed, smooth_shape, turn_about
from mpsnet_core.synthesis.shapes.solids import curved_limb, cylinder, ellipsoid, ring
from mpsnet_core.synthesis.shapes.surfaces import (
    displaced,
    slab,
    smooth_profile,
    sphere,
    stacked,
    tube,
    turned_profile,
)

Array = NDArray[np.float64]


def hat(rng: np.random.Generator) -> Shape:
    """A hat for a head of radius 1 whose brim lies at z = 0."""
    kind = picked(rng, ("brim", "cone", "top", "cap", "crown", "bobble"), (4, 2, 2, 2, 1, 2))
    high, wide = between(rng, 0.6, 1.3), between(rng, 1.3, 2.1)
    if kind == "brim":
        droop = between(rng, -0.3, 0.2)
        profile = [
            (0.02, 0.05),
            (0.9, 0.0),
            (wide, droop - 0.05),
            (wide + 0.04, droop),
            (wide, droop + 0.05),
            (1.0, 0.12),
        ]
        profile += [(0.85, 0.5 * high), (between(rng, 0.4, 0.8), 0.95 * high), (0.02, high)]
        return turned_profile(smooth_profile(profile), DRESS)
    if kind == "cone":
        profile = [(0.02, 0), (1.0, -0.05), (1.05, 0.05), (0.55, 1.0 * high), (0.08, 2.0 * high), (0.02, 2.05 * high)]
        return turned_profile(smooth_profile(profile), DRESS)
    if kind == "top":
        profile = [(0.02, 0), (1.3, -0.04), (1.38, 0.0), (1.3, 0.05), (0.9, 0.1), (0.85, high), (0.95, 1.3 * high)]
        profile += [(0.9, 1.36 * high), (0.02, 1.36 * high)]
        return turned_profile(smooth_profile(profile), DRESS)
    if kind == "cap":
        profile = [(0.02, -0.1), (1.0, -0.12), (1.15, 0.1), (wide * 0.75, 0.3), (1.0, 0.55), (0.02, 0.6)]
        return turned_profile(smooth_profile(profile), DRESS)
    if kind == "crown":
        spikes, angles = count(rng, 4, 9), np.linspace(0, 2 * np.pi, 144, endpoint=False)
        rim = 0.5 * high * np.abs(np.sin(spikes * angles / 2)) + 0.35 * high
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        rings = [np.column_stack([circle * 0.85, np.zeros(144)]), np.column_stack([circle * 1.02, np.zeros(144)])]
        rings += [np.column_stack([circle * r, rim]) for r in (1.15, 1.12, 1.02, 0.98)]
        rings.append(np.column_stack([circle * 0.86, np.full(144, 0.1)]))
        return stacked(np.stack(rings), DRESS)
    profile = [
        (0.02, -0.1),
        (1.0, -0.15),
        (1.12, -0.05),
        (1.12, 0.2),
        (1.0, 0.25),
        (0.85, 0.7),
        (0.3, high + 0.2),
        (0.02, high + 0.25),
    ]
    cap = turned_profile(smooth_profile(profile), DRESS)
    return joined([cap, ball(between(rng, 0.2, 0.38), (0, 0, high + 0.35), FEATURES)])


def ball(radius: float, centre: ArrayLike = (0, 0, 0), part: int = LOAD) -> Shape:
    """A ball."""
    vertices, triangles = sphere(4)
    return smooth_shape(vertices * radius + np.asarray(centre), triangles, vertices, part)


def sack(rng: np.random.Generator, size: float) -> Shape:
    """A tied sack, about 2 `size` wide, standing around the origin, with folds that run into its neck."""
    high, neck = between(rng, 1.0, 1.5), between(rng, 0.2, 0.35)
    profile = [(0.02, -1.0), (0.6, -0.98), (0.95, -0.6), (between(rng, 0.85, 1.05), -0.1), (0.65, 0.45 * high)]
    profile += [
        (neck, 0.72 * high),
        (0.55 * neck + 0.25, 0.95 * high),
        (0.4 * neck + 0.15, 0.97 * high),
        (0.02, 0.8 * high),
    ]
    shape = turned_profile(smooth_profile(profile, 12), LOAD, 120)
    folds, depth, seed = count(rng, 5, 11), between(rng, 0.03, 0.09), new_seed(rng)

    def height(points: Array) -> Array:
        angles = np.arctan2(points[:, 1], points[:, 0])
        bent = angles + 0.5 * gradient_noise(points * 1.3, seed)
        near = np.clip((points[:, 2] + 1.0) / (0.72 * high + 1.0), 0, 1) ** 2
        radius = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2)
        fade = np.clip(radius / 0.6, 0, 1) ** 1.5
        return depth * fade * near * np.cos(folds * bent) + 0.12 * fade * gradient_noise(points * 1.6, seed + 1)

    rope = tube(_circle(neck * 1.12, 0.72 * high), 0.07, DRESS, 10)
    return placed(joined([displaced(shape, height), rope]), scale=size)


def thing(rng: np.random.Generator, place: ArrayLike, size: float) -> list[Piece]:
    """Something to carry, about 2 `size` wide, around `place`."""
    kind = picked(rng, ("sack", "box", "ball", "basket", "book", "drum", "pillow", "jar"), (4, 3, 2, 2, 1, 2, 2, 2))
    centre = np.asarray(place, np.float64)
    axes = turn_about((0, 0, 1), between(rng, -60, 60)) @ turn_about((1, 0, 0), between(rng, -20, 20))
    if kind == "sack":
        return [placed(sack(rng, size * 0.9), axes, 1.0, centre)]
    if kind == "box":
        half = size * np.array([between(rng, 0.6, 1), between(rng, 0.5, 1), between(rng, 0.5, 1)])
        return [crate(half, between(rng, 0.06, 0.3) * size, axes, centre)]
    if kind == "ball":
        return [ball(0.85 * size, centre)]
    if kind == "book":
        return [crate(size * np.array([0.95, 0.75, 0.22]), 0.05 * size, axes @ turned(rng), centre)]
    if kind == "drum":
        return [
            cylinder(centre, 0.85 * size, between(rng, 0.4, 0.8) * size, 0.06 * size, axes, part=LOAD),
            ring(centre + 0.35 * size * axes[2], 0.87 * size, 0.07 * size, axes, blend=0.02, part=FEATURES),
        ]
    if kind == "pillow":
        return [ellipsoid(centre, size * np.array([1.0, between(rng, 0.35, 0.7), 0.75]), axes, blend=0.02, part=LOAD)]
    low, lip = between(rng, 0.4, 0.7), between(rng, 0.6, 0.95)
    profile = [
        (0.02, -0.8),
        (low, -0.8),
        (low * 1.1, -0.7),
        (0.9, 0.0),
        (lip, 0.7),
        (lip, 0.76),
        (lip - 0.1, 0.74),
        (0.75, 0.0),
        (0.02, -0.5),
    ]
    jar = turned_profile(smooth_profile(profile), LOAD)
    if kind == "jar":
        return [placed(jar, axes, size, centre)]
    angles = np.linspace(0, np.pi, 25)
    arch = np.column_stack([(lip - 0.03) * np.cos(angles), np.zeros(25), 0.7 + between(rng, 0.5, 1.1) * np.sin(angles)])
    heap = [
        ball(between(rng, 0.25, 0.4), (between(rng, -0.35, 0.35), between(rng, -0.35, 0.35), 0.45), FEATURES)
        for _ in range(4)
    ]
    return [placed(joined([jar, tube(arch, 0.08, LOAD), *heap]), axes, size, centre)]


def crate(
    half: ArrayLike, bevel: float, axes: ArrayLike | None = None, centre: ArrayLike = (0, 0, 0), part: int = LOAD
) -> Shape:
    """A box with rounded edges of half sizes `half`."""
    x, y, z = np.asarray(half, np.float64)
    bevel = min(bevel, 0.4 * min(x, y, z))
    corner = 1.25 * bevel
    turns = np.radians(np.linspace(0, 90, 5))
    corners = [(np.cos(t + q * np.pi / 2), np.sin(t + q * np.pi / 2), q) for q in range(4) for t in turns]
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    outline = np.array([signs[q] * (x - corner, y - corner) + corner * np.array([c, s]) for c, s, q in corners])
    return placed(placed(slab(outline, 2 * z, bevel, part), offset=(0, 0, -z)), axes, 1.0, centre)


def _circle(radius: float, height: float) -> Array:
    angles = np.linspace(0, 2 * np.pi, 49)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(49, height)])


def fruit(rng: np.random.Generator, size: float) -> Shape:
    """A round fruit, gourd or loaf about the origin."""
    profile = [
        (0.02, -0.85),
        (0.5, -0.95),
        (0.95, -0.4),
        (between(rng, 0.6, 1.0), 0.2),
        (between(rng, 0.3, 0.8), 0.7),
        (0.02, between(rng, 0.6, 1.0)),
    ]
    shape = turned_profile(smooth_profile(profile), LOAD)
    if chance(rng, 0.4):
        ribs, depth = count(rng, 6, 12), between(rng, 0.03, 0.1)
        shape = displaced(
            shape,
            lambda p: depth * np.clip(p[:, 0] ** 2 + p[:, 1] ** 2, 0, 1) * np.cos(ribs * np.arctan2(p[:, 1], p[:, 0])),
        )
    return placed(shape, scale=size)


def canopy(rng: np.random.Generator, radius: float, height: float) -> list[Piece]:
    """A roof, a sunshade or a treetop over the origin, on posts."""
    kind = picked(rng, ("roof", "shade", "tree"))
    wide = radius * between(rng, 0.7, 1.1)
    if kind == "shade":
        foot = np.array([between(rng, -0.3, 0.3), 0.8 * radius, 0.0])
        top = foot * (0.7, 0.7, 1) + (0, 0, height)
        profile = [(0.02, 0.0), (0.5, -0.02), (0.95, -0.2), (1.0, -0.18), (0.55, 0.12), (0.02, between(rng, 0.2, 0.5))]
        roof = placed(turned_profile(smooth_profile(profile), DRESS), None, wide, top)
        return [roof, tube(np.linspace(foot, top, 8), 0.05, BASE)]
    posts = count(rng, 2, 4) if kind == "roof" else 1
    angles = between(rng, 0, 6.3) + np.arange(posts) * (2 * np.pi / posts)
    feet = [np.array([np.cos(a), np.sin(a), 0]) * 0.9 * radius for a in angles]
    if kind == "roof":
        tops = [foot * 0.85 + (0, 0, height) for foot in feet]
        roof = crate((wide, wide * between(rng, 0.6, 1), between(rng, 0.05, 0.15)), 0.04, None, (0, 0, height), DRESS)
        return [roof, *(tube(np.linspace(foot, top, 8), 0.06, BASE) for foot, top in zip(feet, tops, strict=True))]
    crown = 0.4 * feet[0] + (0, 0, height)
    leaves = [
        ellipsoid(crown + direction(rng) * 0.35 * wide, wide * between(rng, 0.3, 0.5), blend=0.05, part=DRESS)
        for _ in range(count(rng, 3, 6))
    ]
    return [
        *leaves,
        *curved_limb((feet[0], feet[0] + (0, 0, 0.7 * height), crown), (0.16, 0.1, 0.08), blend=0.1, part=BASE),
    ]
