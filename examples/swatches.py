"""Swatches for material.py: cloth and leather that lie flat, and their photo, generated from a seed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.synthesis.noise import fractal_noise, gradient_noise, voronoi

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Swatch:
    """A flat piece of material, seen from above. height: (H, W) in millimetres. albedo: (H, W, 3). pixel_mm: a
    pixel's side."""

    height: NDArray[np.float32]
    albedo: NDArray[np.float32]
    pixel_mm: float

    @property
    def normals(self) -> NDArray[np.float32]:
        """(H, W, 3) unit normals of the heights, by central differences."""
        down, right = np.gradient(self.height.astype(np.float64), self.pixel_mm)
        return normalised(np.stack([-right, down, np.ones_like(down)], axis=-1).astype(np.float32))


def woven(
    shape: tuple[int, int],
    pixel_mm: float,
    seed: int,
    *,
    thread_mm: float = 1.0,
    turn: float = 0.0,
    colours: ArrayLike = ((0.33, 0.3, 0.24), (0.42, 0.39, 0.32)),
) -> Swatch:
    """A plain weave: threads that go over and under each other by turns, a little uneven, frayed and bent.

    shape: (H, W). thread_mm: from a thread to the next; the weave repeats after two. turn: degrees by which it lies
    turned, counter-clockwise. colours: (2, 3) of the upright and of the lying threads.
    """
    x, y, points = _places(shape, pixel_mm)
    angle = np.radians(turn)
    across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    u, v = (
        side / thread_mm + 0.12 * _noise(points / (9 * thread_mm), seed + k, shape)
        for k, side in enumerate((across, along))
    )
    fibre = 0.1 * fractal_noise(points / (0.3 * thread_mm), seed + 2, 3).reshape(shape).astype(np.float64)
    upright = np.sin(np.pi * (u % 1)) + 0.8 * np.cos(np.pi * (np.floor(u) + v - 0.5))
    lying = np.sin(np.pi * (v % 1)) - 0.8 * np.cos(np.pi * (np.floor(v) + u - 0.5))
    top = np.logaddexp(8 * upright, 8 * lying) / 8  # the higher one, without a step between them
    strands = [
        1 + 0.16 * _noise(points * (a, b, 1) / thread_mm, seed + 5, shape) for a, b in ((1.0, 0.15), (0.15, 1.0))
    ]
    above = upright > lying
    colour_above, colour_below = np.asarray(colours, np.float64)
    shade = np.where(above, strands[0], strands[1]) * (1 + 0.8 * fibre)
    albedo = np.where(above[..., None], colour_above, colour_below) * shade[..., None]
    height = 0.16 * thread_mm * (top + fibre)
    return Swatch(height.astype(np.float32), np.clip(albedo, 0.01, 0.95).astype(np.float32), pixel_mm)


def leather(
    shape: tuple[int, int], pixel_mm: float, seed: int, *, grain_mm: float = 2.0, colour: ArrayLike = (0.42, 0.2, 0.09)
) -> Swatch:
    """Leather: pebbles of about `grain_mm`, parted by creases, with pores and stains; it repeats nowhere."""
    _, _, points = _places(shape, pixel_mm)
    waver = [gradient_noise(points / grain_mm, seed + 7 + k) for k in range(3)]
    bent = points + 0.25 * grain_mm * np.stack(waver, axis=1)
    border = voronoi(bent * (1, 0.8, 1) / grain_mm, seed)[2].reshape(shape).astype(np.float64)
    dome = 1 - np.exp(-border / 0.09)
    rough = 0.08 * fractal_noise(points / (0.25 * grain_mm), seed + 1, 3).reshape(shape)
    uneven = 0.25 * fractal_noise(points / (2.5 * grain_mm), seed + 2, 2).reshape(shape)
    height = 0.13 * grain_mm * (dome + rough + uneven)
    stains = 1 + 0.12 * fractal_noise(points / (3 * grain_mm), seed + 3, 3).reshape(shape)
    shade = stains * (0.6 + 0.4 * dome) * (1 + 0.6 * rough)
    albedo = np.asarray(colour, np.float64) * shade[..., None]
    return Swatch(height.astype(np.float32), np.clip(albedo, 0.01, 0.95).astype(np.float32), pixel_mm)


def photographed(
    swatch: Swatch, rig: LightRig, *, tilt: tuple[float, float] = (0.0, 0.0), noise: float = 0.0, seed: int = 0
) -> NDArray[np.float32]:
    """(H, W, 3) the linear photo of a swatch that is matt: ``c = M (albedo * max(n·l, 0))``.

    tilt: slopes along x and y by which it does not lie square to the camera. noise: standard deviation added to it.
    """
    tilted = swatch.normals - swatch.normals[..., 2:] * np.array([*tilt, 0], np.float32)
    light = np.maximum(normalised(tilted) @ rig.directions.T, 0) * swatch.albedo
    photo = light @ rig.mixing.T
    if noise:
        photo = photo + np.random.Generator(np.random.PCG64(seed)).normal(0, noise, photo.shape)
    return np.maximum(photo, 0).astype(np.float32)


def _places(shape: tuple[int, int], pixel_mm: float) -> tuple[Array, Array, Array]:
    """x and y (H, W) of the pixels' middles in millimetres, y upwards, and the same as points (H W, 3)."""
    x, y = np.meshgrid((np.arange(shape[1]) + 0.5) * pixel_mm, (shape[0] - np.arange(shape[0]) - 0.5) * pixel_mm)
    return x, y, np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def _noise(points: Array, seed: int, shape: tuple[int, int]) -> Array:
    return gradient_noise(points, seed).reshape(shape).astype(np.float64)
