"""A matt ball or lump close to the lens and to its lights, drawn by formulas of its own, and what is true of it."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from synthetic import Sphere

from mpsnet_core import Camera, Capture, LightRig, near_rig, published_rig

SIZE = 160
WIDE = 24.0  # mm on a sensor of 36 mm
DIRECTIONS = published_rig().directions
# The ball's diameter is 2: its lights stand 1.5 times its size from its middle.
NEAR = 3.0


@dataclass(frozen=True)
class Scene(Sphere):
    """A sphere or lump close to the lens."""

    camera: Camera
    depth: np.ndarray

    def capture(self, **changes: Any) -> Capture:
        return super().capture(**{"camera": self.camera, "depth": self.depth, **changes})


@cache
def ball(
    lens: float | None = WIDE, near: float | None = None, lobe: float = 0.0, mixing: Any = None, size: int = SIZE
) -> Scene:
    """A ball of radius 1. lens: in mm, None for an orthographic camera. near: distance of the lights, None for suns.

    Intersections by the quadratic formula, light by the cosine and the inverse square.
    """
    half = np.radians(1.02 * 90) if lens is None else np.arctan(18 / lens)
    away = 4.0 if lens is None else 1.04 / np.sin(half)
    places = None if near is None else near * DIRECTIONS + [0, 0, -away]
    mix = np.eye(3) if mixing is None else np.array(mixing, float)
    rig = LightRig(DIRECTIONS, mix) if places is None else near_rig(places, [0, 0, -away], mix, lobe)
    x = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(x, -x)
    if lens is None:
        start, ray = np.stack([x * 1.04, y * 1.04, 0 * x], axis=-1), np.array([0, 0, -1.0])
    else:
        start, ray = np.zeros(3), np.stack([x * 18, y * 18, 0 * x - lens], axis=-1)
        ray /= np.sqrt(18**2 * (x * x + y * y) + lens**2)[..., None]
    middle = np.array([0, 0, -away])
    b = (ray * (start - middle)).sum(axis=-1)
    inside = b * b - ((start - middle) ** 2).sum(axis=-1) + 1
    mask = inside >= 0.003  # without the very rim
    point = start + ray * (-b - np.sqrt(np.maximum(inside, 0)))[..., None]
    normals = np.where(mask[..., None], point - middle, 0)
    shares = np.maximum(normals @ DIRECTIONS.T, 0)
    for number in range(3 if places is not None else 0):
        towards = places[number] - point
        reach = np.sqrt((towards**2).sum(axis=-1))
        off_axis = towards @ DIRECTIONS[number] / reach
        falls = np.maximum((normals * towards).sum(axis=-1) / reach, 0)
        shares[..., number] = falls * (near / reach) ** 2 * off_axis**lobe
    kind, focal = ("orthographic", size / 2.08) if lens is None else ("perspective", lens / 36 * size)
    camera = Camera(kind, size, size, np.full(2, focal))
    image, depth = shares @ mix.T, np.where(mask, -point[..., 2], 1)
    lit = shares.min(axis=-1) > 0
    return Scene(image.astype(np.float32), normals, mask, lit, rig, camera, depth.astype(np.float32))
