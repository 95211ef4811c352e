"""Photographs of balls, traced ray by ray without the core's help.

Camera space as everywhere: x right, y up, z towards the camera. A perspective camera stands at the origin; an
orthographic one looks from far away, a pixel a unit, the photo's middle at x = y = 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mpsnet_core.io.image import Image

# Colours (N, 3) of places on a ball (N, 3), which rays in directions (N, 3) meet, by the normals there (N, 3).
Shade = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
CROSSTALK = np.array([[1.0, 0.3, 0.3], [0.3, 1.0, 0.3], [0.3, 0.3, 1.0]])


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of the vectors along the last axis; much faster than a sum along it."""
    return np.einsum("...i,...i->...", a, b)


@dataclass(frozen=True)
class Scene:
    """Balls (middle and radius), lamps (middle and radius), and the camera. focal: in pixels; None is orthographic."""

    balls: Sequence[tuple[Sequence[float], float]]
    lamps: Sequence[tuple[Sequence[float], float]]
    size: tuple[int, int] = (400, 300)  # width, height
    focal: float | None = None

    def eye_rays(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        right, up = x - self.size[0] / 2, self.size[1] / 2 - y
        if self.focal is None:
            starts = np.stack([right, up, np.full_like(x, 1e4)], -1)
            return starts, np.broadcast_to(np.array([0.0, 0.0, -1.0]), starts.shape)
        aims = np.stack([right, up, np.full_like(x, -self.focal)], -1)
        return np.zeros_like(aims), aims / np.linalg.norm(aims, axis=-1, keepdims=True)

    def hits(self, starts: np.ndarray, aims: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Which rays meet a ball, where, and the outward normal there."""
        nearest = np.full(starts.shape[:-1], np.inf)
        normals = np.zeros_like(starts)
        for middle, radius in self.balls:
            from_middle = starts - np.asarray(middle)
            half = dot(from_middle, aims)
            root = half**2 - dot(from_middle, from_middle) + radius**2
            distance = -half - np.sqrt(np.maximum(root, 0))
            nearer = (root > 0) & (distance > 0) & (distance < nearest)
            nearest = np.where(nearer, distance, nearest)
            normals[nearer] = ((from_middle + distance[..., None] * aims) / radius)[nearer]
        met = np.isfinite(nearest)
        return met, starts + np.where(met, nearest, 0)[..., None] * aims, normals

    def lamp_seen(self, starts: np.ndarray, aims: np.ndarray, lamp: int) -> np.ndarray:
        middle, radius = self.lamps[lamp]
        towards = np.asarray(middle) - starts
        along = dot(towards, aims)
        return (along > 0) & (dot(towards, towards) - along**2 < radius**2)

    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """x, y of their middles."""
        return tuple(np.meshgrid(*(np.arange(length) + 0.5 for length in self.size)))

    def drawn(self, background: np.ndarray | float, shade: Shade, fine: int = 2) -> np.ndarray:
        """(H, W, 3) the balls before a background: the mean of fine × fine rays a pixel, where a ball may be met."""
        x, y = self.pixels()
        larger = Scene([(middle, 1.1 * radius) for middle, radius in self.balls], [], self.size, self.focal)
        near, _, _ = larger.hits(*self.eye_rays(x, y))
        image = np.broadcast_to(np.asarray(background, float)[..., None], (*x.shape, 3)).copy()
        step = (np.arange(fine) + 0.5) / fine - 0.5
        x, y = np.broadcast_arrays(x[near][:, None, None] + step, y[near][:, None, None] + step[:, None])
        starts, aims = self.eye_rays(x, y)
        met, places, normals = self.hits(starts, aims)
        values = np.tile(image[near][:, None, None], (1, fine, fine, 1))
        values[met] = shade(places[met], aims[met], normals[met])
        image[near] = values.mean((1, 2))
        return image


def photograph(
    scene: Scene,
    colours: np.ndarray = CROSSTALK,
    *,
    brightness: float = 0.8,
    room: float = 0.02,
    noise: float = 0.002,
    levels: int | None = 65535,
    on: Sequence[int] | None = None,
    white_lamp: tuple[Sequence[float], float, float] | None = None,
    fine: int = 2,
    seed: int = 0,
) -> np.ndarray:
    """(H, W, 3) a mirror ball's photo, clipped at 1.

    colours: (3, N) what each channel sees of each lamp. room: how bright the walls are that it mirrors, and that
    stand behind it. on: which lamps are lit. white_lamp: another one, by its middle, radius and brightness.
    """

    def mirror(places: np.ndarray, aims: np.ndarray, normals: np.ndarray) -> np.ndarray:
        mirrored = aims - 2 * dot(aims, normals)[:, None] * normals
        # Walls with a floor that begins below the horizon, a stripe and a lighter corner.
        walls = room * (0.3 + 0.3 * (mirrored[:, 1] > -0.2) + 0.2 * (np.abs(mirrored[:, 0] - 0.3) < 0.1))
        ball = np.repeat(walls[:, None], 3, -1)
        for lamp in range(len(scene.lamps)) if on is None else on:
            ball += scene.lamp_seen(places, mirrored, lamp)[:, None] * brightness * colours[:, lamp]
        if white_lamp is not None:
            middle, radius, power = white_lamp
            other = Scene(scene.balls, [(middle, radius)], scene.size, scene.focal)
            ball += other.lamp_seen(places, mirrored, 0)[:, None] * power
        return ball

    x, y = scene.pixels()
    behind = room * (1.2 + 0.5 * np.sin(x / 17) * np.cos(y / 23) + 0.8 * (y > 0.72 * scene.size[1]))
    return developed(scene.drawn(behind, mirror, fine), noise, levels, seed)


def grey_photograph(
    scene: Scene,
    mixing: np.ndarray,
    directions: np.ndarray,
    *,
    albedo: float = 0.5,
    noise: float = 0.003,
    levels: int | None = 65535,
    ambient: float = 0.0,
    fine: int = 2,
    seed: int = 0,
) -> np.ndarray:
    """(H, W, 3) a matt ball under distant lights, on black."""

    def matt(_places: np.ndarray, _aims: np.ndarray, normals: np.ndarray) -> np.ndarray:
        return albedo * (np.clip(normals @ np.asarray(directions).T, 0, None) @ np.asarray(mixing).T + ambient)

    return developed(scene.drawn(0.0, matt, fine), noise, levels, seed)


def taken(pixels: np.ndarray) -> Image:
    """What the core takes for a photo whose channels end at 1."""
    return Image(pixels, None, 1.0)


def developed(values: np.ndarray, noise: float, levels: int | None, seed: int = 0) -> np.ndarray:
    """With a sensor's noise (its deviation at 1; smaller in the dark), clipped at 1 and in whole levels."""
    random = np.random.default_rng(seed)
    values = np.maximum(values, 0)
    values = values + noise * np.sqrt(values + 0.02) * random.standard_normal(values.shape)
    values = np.clip(values, 0, 1)
    return (values if levels is None else np.rint(values * levels) / levels).astype(np.float32)


def around(slant: float, tilt: float) -> np.ndarray:
    """A unit vector by degrees."""
    slant, tilt = np.radians(slant), np.radians(tilt)
    return np.array([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)])


def lamps_around(target: Sequence[float], distance: float, degrees: float = 5.0, angles=None):
    """Three lamps at a distance from the target that look `degrees` across from there."""
    angles = angles or [(30, 90), (35, 205), (25, 335)]
    radius = distance * np.tan(np.radians(degrees / 2))
    return [(np.asarray(target) + distance * around(*angle), radius) for angle in angles]
