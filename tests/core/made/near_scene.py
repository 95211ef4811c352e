"""A matt ball or lump close to the lens and to its lights, drawn by formulas of its own, and what is true of it."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from mpsnet_core import Camera, Capture, LightRig, near_rig, published_rig

SIZE = 160
WIDE = 24.0  # mm on a sensor of 36 mm
DIRECTIONS = published_rig().directions
# The ball's diameter is 2: its lights stand 1.5 times its size from its middle.
NEAR = 3.0


@dataclass(frozen=True)
class Scene:
    """lit: (H, W) where all three lights reach. rest: for :class:`Capture`, beside image, mask and rig."""

    image: np.ndarray
    normals: np.ndarray
    mask: np.ndarray
    lit: np.ndarray
    rig: LightRig
    camera: Camera
    depth: np.ndarray

    def capture(self, **changes: Any) -> Capture:
        known = {name: getattr(self, name) for name in ("image", "mask", "rig", "camera", "depth")}
        return Capture(**{**known, **changes})


@cache
def ball(
    lens: float | None = WIDE, near: float | None = None, lobe: float = 0.0, mixing: Any = None, size: int = SIZE
) -> Scene:
    """A ball of radius 1. lens: in mm, None for an orthographic camera. near: distance of the lights, None for suns.

    Intersections by the quadratic formula, light by the cosine and the inverse square, a pixel at a time in loops.
    """
    half = np.radians(1.02 * 90) if lens is None else np.arctan(18 / lens)
    away = 4.0 if lens is None else 1.04 / np.sin(half)
    places = None if near is None else near * DIRECTIONS + [0, 0, -away]
    mix = np.eye(3) if mixing is None else np.array(mixing, float)
    rig = LightRig(DIRECTIONS, mix) if places is None else near_rig(places, [0, 0, -away], mix, lobe)
    image, normals, depth = np.zeros((size, size, 3)), np.zeros((size, size, 3)), np.ones((size, size))
    mask, lit = np.zeros((size, size), bool), np.zeros((size, size), bool)
    middle = np.array([0, 0, -away])
    for row in range(size):
        for column in range(size):
            x, y = (column + 0.5) / size * 2 - 1, 1 - (row + 0.5) / size * 2
            if lens is None:
                start, ray = np.array([x * 1.04, y * 1.04, 0]), np.array([0, 0, -1.0])
            else:
                start, ray = np.zeros(3), np.array([x * 18, y * 18, -lens]) / np.sqrt(18**2 * (x * x + y * y) + lens**2)
            b = ray @ (start - middle)
            inside = b * b - (start - middle) @ (start - middle) + 1
            if inside < 0.003:  # the very rim
                continue
            point = start + ray * (-b - np.sqrt(inside))
            normal = point - middle
            shares = []
            for number in range(3):
                if places is None:
                    shares.append(max(normal @ DIRECTIONS[number], 0))
                    continue
                towards = places[number] - point
                reach = np.sqrt(towards @ towards)
                off_axis = towards @ DIRECTIONS[number] / reach
                shares.append(max(normal @ towards / reach, 0) * (near / reach) ** 2 * off_axis**lobe)
            image[row, column] = mix @ shares
            normals[row, column], depth[row, column], mask[row, column] = normal, -point[2], True
            lit[row, column] = min(shares) > 0
    camera = Camera(
        "orthographic" if lens is None else "perspective",
        size,
        size,
        np.full(2, size / 2.08 if lens is None else lens / 36 * size),
    )
    return Scene(image.astype(np.float32), normals, mask, lit, rig, camera, depth.astype(np.float32))
