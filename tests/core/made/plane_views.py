"""A square to bake onto, and views in which every pixel has one normal."""

from dataclasses import replace

import numpy as np

from mpsnet_core import Camera, Mesh, NormalMap, View, join_meshes

SIZE = 96

SIX_SIDES = [(1, 0.1, 0), (-1, 0, 0.1), (0, 1, 0.1), (0.1, -1, 0), (0.1, 0, 1), (0, 0.1, -1)]


def plane(world_from_object: np.ndarray | None = None) -> Mesh:
    """The square from -1 to 1 in z = 0, its front at +z, its UVs the whole texture."""
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3))
    uvs = (vertices[triangles][..., :2] + 1) / 2
    return Mesh(vertices, triangles, normals, uvs, None, np.eye(4) if world_from_object is None else world_from_object)


def plate_before_plane() -> Mesh:
    """The square in a quarter of the texture, and in the opposite one a small plate that floats before it."""
    back = plane()
    front = replace(back, vertices=back.vertices * (0.3, 0.3, 1) + (0, 0, 0.5), uvs=0.5 * back.uvs + 0.5)
    return join_meshes([replace(back, uvs=0.5 * back.uvs), front])


def constant_view(camera: Camera, world_normal: list[float], confidence: float | np.ndarray = 1.0) -> View:
    """A view in which every pixel says `world_normal`."""
    shape = (camera.height, camera.width)
    vectors = np.broadcast_to(np.array(world_normal) @ camera.rotation, (*shape, 3))
    return View(camera, NormalMap(vectors, np.ones(shape, bool), np.broadcast_to(confidence, shape)))
