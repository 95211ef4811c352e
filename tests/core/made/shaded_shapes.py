"""Shapes and recipes whose pictures are known without the core's shading: balls and rectangles under distant lights."""

from typing import Any

import numpy as np
from surface_shapes import sphere_mesh

from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.scene_description import Material, SceneDescription
from mpsnet_core.synthesis.shapes.shape import Shape, faceted_shape, smooth_shape


class Lambert:
    """A matt surface of one colour."""

    def __init__(self, albedo: float = 1.0) -> None:
        self.albedo = albedo

    def __call__(
        self, normals: np.ndarray, lights: np.ndarray, views: np.ndarray, paint: np.ndarray | None = None
    ) -> np.ndarray:
        above = ((normals * lights).sum(1) > 0) & ((normals * views).sum(1) > 0)
        factors = np.ones((len(normals), 3)) if paint is None else paint
        return (above[:, None] * factors * self.albedo / np.pi).astype(np.float32)


def ball(radius: float = 1.0, centre: tuple[float, float, float] = (0, 0, 0), rows: int = 160) -> Shape:
    mesh = sphere_mesh(2 * rows, rows)
    return smooth_shape(radius * mesh.vertices + centre, mesh.triangles.astype(np.int32), mesh.vertices)


def rectangle(corner: tuple[float, ...], along: tuple[float, ...], across: tuple[float, ...]) -> Shape:
    """Two triangles that face along x across."""
    a, b, c = np.array([corner, along, across], float)
    return faceted_shape(np.array([a, a + b, a + b + c, a + c]), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def camera(size: int, projection: str = "orthographic", reach: float = 1.05, distance: float = 4.0) -> Camera:
    """On the z axis, framing `reach` around the origin."""
    pose = np.eye(4)
    pose[2, 3] = distance
    focal = size / 2 / reach * (distance if projection == "perspective" else 1)
    return Camera(projection, size, size, [focal, focal], None, pose)


def recipe(size: int = 64, **settings: Any) -> SceneDescription:
    """A recipe of one plain material; lights 40 degrees from the view, 120 apart, points at infinity."""
    plain: dict[str, Any] = {
        "seed": 1,
        "number": 2,
        "shape": {},
        "rotation": np.eye(3),
        "camera": camera(size),
        "light_directions": direction_from_angles([40] * 3, [90, 210, 330]),
        "light_sizes": np.zeros(3),
        "materials": (Material(),),
    }
    return SceneDescription(**(plain | settings))


def plane_points(view: Camera) -> np.ndarray:
    """(H, W, 3) where the pixels' centres of an orthographic camera on the z axis meet the plane z = 0."""
    row, column = np.mgrid[: view.height, : view.width] + 0.5
    x, y = (column - view.width / 2) / view.focal[0], (view.height / 2 - row) / view.focal[1]
    return np.stack([x, y, np.zeros_like(x)], axis=-1)
