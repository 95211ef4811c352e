"""Surfaces as height maps whose heights, normals and all that follows from them are known without the core."""

from dataclasses import dataclass

import height_shapes
import numpy as np

from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap


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


def ball(camera: Camera, middle: tuple[float, float, float], radius: float) -> Relief:
    """A ball in camera space."""
    return _relief(height_shapes.spheres(camera, (*middle, radius)))


def plane(camera: Camera, gradient: tuple[float, float], distance: float) -> Relief:
    """The plane z = slope . (x, y) - distance, in camera space, over the whole picture."""
    return _relief(height_shapes.plane(camera, (-gradient[0], -gradient[1], 1.0), -distance))


def _relief(surface: height_shapes.Surface) -> Relief:
    return Relief(HeightMap(surface.heights, surface.mask, surface.camera), surface.normals)


def bowl(camera: Camera, middle: tuple[float, float, float], radius: float) -> Relief:
    """The far side of a hollow ball to 60° from its axis, in camera space, by the equation of the rays."""
    x, y = height_shapes.places(camera)
    zero, one = np.zeros_like(x), np.ones_like(x)
    flat = camera.projection == "orthographic"
    origin = np.stack([x, y, zero] if flat else [zero] * 3, axis=-1)
    ray = np.stack([zero, zero, -one] if flat else [x, y, -one], axis=-1)
    to = origin - np.array(middle)
    a, b, c = (ray * ray).sum(-1), (ray * to).sum(-1), (to * to).sum(-1) - radius**2
    root = b * b - a * c
    points = origin + ((np.sqrt(np.maximum(root, 0)) - b) / a)[..., None] * ray
    outwards = (points - middle) / radius
    mask = (root > 0) & (outwards[..., 2] < -0.5)
    return Relief(HeightMap(points[..., 2], mask, camera), NormalMap(-outwards, mask))


def bumps(camera: Camera, depth: float = 0.0, size: float = 1.0) -> Relief:
    """Round hills and pits over the whole picture, `size` times a tenth of half its width high."""
    x, y = height_shapes.places(camera)
    ones, reach = np.ones_like(x), np.abs(x).max()
    wave, tall = 3 * np.pi / reach, 0.1 * reach * size
    z = tall * np.sin(wave * x) * np.cos(0.8 * wave * y)
    dx = tall * wave * np.cos(wave * x) * np.cos(0.8 * wave * y)
    dy = -0.8 * tall * wave * np.sin(wave * x) * np.sin(0.8 * wave * y)
    if camera.projection == "orthographic":
        normals = np.stack([-dx, -dy, ones], axis=-1)
        return Relief(HeightMap(z - depth, ones > 0, camera), NormalMap(normals, ones > 0))
    # Along each ray, t = depth (1 - z): the cross product of the surface's tangents over x and y at depth 1.
    t = depth * (1 - z)
    across = np.stack([t - depth * dx * x, -depth * dx * y, depth * dx], axis=-1)
    upwards = np.stack([-depth * dy * x, t - depth * dy * y, depth * dy], axis=-1)
    return Relief(HeightMap(-t, ones > 0, camera), NormalMap(np.cross(across, upwards), ones > 0))
