"""Surfaces whose heights, normals and all that follows from them are known without the core."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.camera import Camera
from mpsnet_core.heights.height_map import HeightMap
from mpsnet_core.normals import NormalMap


@dataclass(frozen=True)
class Relief:
    heights: HeightMap
    normals: NormalMap

    @property
    def mask(self) -> np.ndarray:
        return self.heights.mask

    @property
    def camera(self) -> Camera:
        return self.heights.camera

    @property
    def depth(self) -> np.ndarray:
        return -self.heights.values


def orthographic(height: int, width: int, pixels_per_unit: float = 1.0, pose: np.ndarray | None = None) -> Camera:
    return Camera("orthographic", width, height, np.full(2, pixels_per_unit), None, np.eye(4) if pose is None else pose)


def ball(camera: Camera, middle: tuple[float, float, float], radius: float, *, inside: bool = False) -> Relief:
    """A ball in camera space by the equation of its rays; `inside`: a bowl, its far side beyond 60° from its axis."""
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x, y = (column - camera.centre[0]) / camera.focal[0], (camera.centre[1] - row) / camera.focal[1]
    zero, one = np.zeros_like(x), np.ones_like(x)
    flat = camera.projection == "orthographic"
    origin = np.stack([x, y, zero] if flat else [zero] * 3, axis=-1)
    ray = np.stack([zero, zero, -one] if flat else [x, y, -one], axis=-1)
    to = origin - np.array(middle)
    a, b, c = (ray * ray).sum(-1), (ray * to).sum(-1), (to * to).sum(-1) - radius**2
    root = b * b - a * c
    along = (-b + (1 if inside else -1) * np.sqrt(np.maximum(root, 0))) / a
    points = origin + along[..., None] * ray
    outwards = (points - middle) / radius
    mask = (root > 0) & (outwards[..., 2] < -0.5 if inside else np.ones_like(root, bool))
    normals = -outwards if inside else outwards
    return Relief(HeightMap(points[..., 2], mask, camera), NormalMap(normals, mask))


def plane(camera: Camera, slope: tuple[float, float], distance: float) -> Relief:
    """The plane z = slope . (x, y) - distance, in camera space, over the whole picture."""
    ones = np.ones((camera.height, camera.width))
    x, y, _ = np.moveaxis(camera.points(ones), -1, 0)
    p, q = slope
    if camera.projection == "orthographic":
        z = p * x + q * y - distance
    else:
        z = -distance / (1 + p * x + q * y)  # z = p (-z x) + q (-z y) - distance
    normals = np.broadcast_to([-p, -q, 1.0], (*ones.shape, 3))
    return Relief(HeightMap(z, ones > 0, camera), NormalMap(normals, ones > 0))


def bumps(camera: Camera, depth: float = 0.0, size: float = 1.0) -> Relief:
    """Round hills and pits over the whole picture, `size` times a tenth of half its width high."""
    ones = np.ones((camera.height, camera.width))
    x, y, _ = np.moveaxis(camera.points(ones), -1, 0)
    reach = np.abs(x).max()
    wave, tall = 3 * np.pi / reach, 0.1 * reach * size
    z = tall * np.sin(wave * x) * np.cos(0.8 * wave * y)
    dx = tall * wave * np.cos(wave * x) * np.cos(0.8 * wave * y)
    dy = -0.8 * tall * wave * np.sin(wave * x) * np.sin(0.8 * wave * y)
    if camera.projection == "orthographic":
        normals = np.stack([-dx, -dy, ones], axis=-1)
        return Relief(HeightMap(z - depth, ones > 0, camera), NormalMap(normals, ones > 0))
    # Along each ray, t = depth (1 - z): the cross product of the surface's two tangents (x, y and t are per unit depth).
    t = depth * (1 - z)
    across = np.stack([t - depth * dx * x, -depth * dx * y, depth * dx], axis=-1)
    upwards = np.stack([-depth * dy * x, t - depth * dy * y, depth * dy], axis=-1)
    return Relief(HeightMap(-t, ones > 0, camera), NormalMap(np.cross(across, upwards), ones > 0))


def grid_triangles(height: int, width: int) -> np.ndarray:
    """(T, 3) two triangles for each square of four pixels, counter-clockwise as the picture is seen."""
    number = np.arange(height * width).reshape(height, width)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
