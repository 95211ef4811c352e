"""Surfaces whose normals and heights are known in every pixel, without the core."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core import Camera, HeightMap, NormalMap


@dataclass(frozen=True)
class Surface:
    """What a camera sees: normals, and the true z of every pixel (H, W) in the camera's unit."""

    normals: NormalMap
    z: np.ndarray
    camera: Camera

    @property
    def mask(self) -> np.ndarray:
        return self.normals.mask

    @property
    def heights(self) -> HeightMap:
        return HeightMap(self.z, self.mask, self.camera)

    @property
    def depth(self) -> np.ndarray:
        return -self.z

    def masked(self, mask: np.ndarray) -> "Surface":
        """The same seen within a smaller mask."""
        return Surface(NormalMap(self.normals.vectors, self.mask & mask), self.z, self.camera)


def square_camera(size: int) -> Camera:
    """Orthographic: the picture shows x and y from -1 to 1."""
    return Camera("orthographic", size, size, [size / 2, size / 2])


def orthographic(height: int, width: int, pixels_per_unit: float = 1.0, pose: np.ndarray | None = None) -> Camera:
    return Camera("orthographic", width, height, np.full(2, pixels_per_unit), None, np.eye(4) if pose is None else pose)


def places(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) x and y of every pixel's middle at depth 1."""
    x, y, _ = np.moveaxis(camera.points(np.ones((camera.height, camera.width))), -1, 0)
    return x, y


def plane(camera: Camera, normal: tuple[float, float, float], middle: float = 0.0) -> Surface:
    """All of the picture shows a plane; its z is `middle` on the axis."""
    x, y = places(camera)
    n_x, n_y, n_z = normal
    shown = np.ones(x.shape, bool)
    vectors = np.broadcast_to(np.array(normal), (*x.shape, 3))
    # n . (p - (0, 0, middle)) = 0, with p = (x, y, z), or -z (x, y, -1) in perspective.
    z = middle - (n_x * x + n_y * y) / n_z
    if camera.projection == "perspective":
        z = n_z * middle / (n_z - n_x * x - n_y * y)
    return Surface(NormalMap(vectors, shown), z, camera)


def spheres(camera: Camera, *balls: tuple[float, float, float, float], rim: float = 0.0) -> Surface:
    """Spheres (x, y, z, radius); what is nearest is seen. rim: the least cosine between normal and line of sight."""
    x, y = places(camera)
    along = np.stack([x, y, -np.ones_like(x)], axis=-1)
    start, way = np.zeros_like(along), along
    if camera.projection == "orthographic":
        start, way = along * (1, 1, 0), np.broadcast_to(np.array([0.0, 0.0, -1.0]), along.shape)
    nearest, vectors, facing = np.full(x.shape, np.inf), np.zeros(along.shape), np.zeros(x.shape)
    for *centre, radius in balls:
        offset = start - centre
        a, b, c = (way * way).sum(-1), (way * offset).sum(-1), (offset * offset).sum(-1) - radius**2
        met = b * b > a * c
        depth = np.where(met, (-b - np.sqrt(np.where(met, b * b - a * c, 0))) / a, np.inf)
        before = depth < nearest
        nearest[before] = depth[before]
        normal = (offset + np.where(met, depth, 0)[..., None] * way) / radius
        vectors[before] = normal[before]
        facing[before] = -((normal * way).sum(-1) / np.sqrt(a))[before]
    mask = np.isfinite(nearest) & (facing > rim)
    return Surface(NormalMap(vectors, mask), np.where(mask, -nearest, 0), camera)


def ball(camera: Camera, middle: tuple[float, float, float], radius: float) -> Surface:
    return spheres(camera, (*middle, radius))


def two_spheres(camera: Camera) -> Surface:
    """Of two spheres one grows out of the other, and stands before it elsewhere: a step that ends."""
    return spheres(camera, (-0.25, -0.1, 0.0, 0.6), (0.3, 0.15, 0.45, 0.5))


def saddle(camera: Camera, bend: float = 0.4) -> Surface:
    """z = bend (x² - y²), orthographic."""
    x, y = places(camera)
    vectors = np.stack([-2 * bend * x, 2 * bend * y, np.ones_like(x)], axis=-1)
    return Surface(NormalMap(vectors, np.ones(x.shape, bool)), bend * (x**2 - y**2), camera)


def bowl(camera: Camera, middle: tuple[float, float, float], radius: float) -> Surface:
    """The far side of a hollow ball to 60° from its axis, in camera space, by the equation of the rays."""
    x, y = places(camera)
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
    return Surface(NormalMap(-outwards, mask), points[..., 2], camera)


def bumps(camera: Camera, depth: float = 0.0, size: float = 1.0) -> Surface:
    """Round hills and pits over the whole picture, `size` times a tenth of half its width high."""
    x, y = places(camera)
    ones, reach = np.ones_like(x), np.abs(x).max()
    wave, tall = 3 * np.pi / reach, 0.1 * reach * size
    z = tall * np.sin(wave * x) * np.cos(0.8 * wave * y)
    dx = tall * wave * np.cos(wave * x) * np.cos(0.8 * wave * y)
    dy = -0.8 * tall * wave * np.sin(wave * x) * np.sin(0.8 * wave * y)
    if camera.projection == "orthographic":
        normals = np.stack([-dx, -dy, ones], axis=-1)
        return Surface(NormalMap(normals, ones > 0), z - depth, camera)
    # Along each ray, t = depth (1 - z): the cross product of the surface's tangents over x and y at depth 1.
    t = depth * (1 - z)
    across = np.stack([t - depth * dx * x, -depth * dx * y, depth * dx], axis=-1)
    upwards = np.stack([-depth * dy * x, t - depth * dy * y, depth * dy], axis=-1)
    return Surface(NormalMap(np.cross(across, upwards), ones > 0), -t, camera)


def off(values: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(N,) how far heights inside the mask are from the truth, but for the constant that brings them closest."""
    away = (values - truth)[mask]
    return np.abs(away - np.median(away))


def torus(size: int, degrees: float, wide: float = 0.68, thick: float = 0.28) -> Surface:
    """A ring leaned back by so many degrees, so that what is near hides some of what is far; by rays and Newton steps.

    The ring's middle line has radius `wide` and is in the plane of x and y before it leans; `thick` is its own radius.
    """
    camera = square_camera(size)
    x, y = places(camera)
    angle = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    way = -turn[2]

    def beyond(place: np.ndarray) -> np.ndarray:
        """How far places (..., 3), in the ring's own frame, are outside it."""
        return np.hypot(np.hypot(place[..., 0], place[..., 1]) - wide, place[..., 2]) - thick

    place = np.stack([x, y, np.full_like(x, 1.5)], axis=-1) @ turn
    still = np.ones(x.shape, bool)
    for _ in range(400):  # steps that cannot pass through it
        left = beyond(place[still])
        place[still] += left[:, None] * way
        still[still] = (left > 1e-12) & (left < 4)
    met = np.abs(beyond(place)) < 1e-6
    radius = np.hypot(place[..., 0], place[..., 1])[..., None]
    out = place - np.concatenate([place[..., :2] / radius * wide, np.zeros_like(radius)], axis=-1)
    vectors = out @ turn.T
    seen = met & (vectors[..., 2] > 0)
    return Surface(NormalMap(vectors, seen), np.where(seen, (place @ turn.T)[..., 2], 0), camera)
