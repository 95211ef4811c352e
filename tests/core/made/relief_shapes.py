"""Surfaces displaced by known heights: meshes in several islands and the normals that a perfect bake would give."""

from collections.abc import Callable

import numpy as np
from surface_shapes import grid_triangles, texels_of

from mpsnet_core.scene.mesh import Mesh

# Sums of sines in space, (wave vectors, phases): amplitudes 1.
WAVES = np.array([[5.0, 1.0, 2.0], [-2.0, 6.0, 1.0], [1.0, -3.0, 7.0], [9.0, 4.0, -5.0]])
PHASES = np.array([0.3, 1.1, 2.0, 0.7])


def waves(points: np.ndarray) -> np.ndarray:
    """(N,) a smooth function of space between about -1 and 1."""
    return np.sin(points @ WAVES.T + PHASES).mean(axis=-1)


def waves_gradient(points: np.ndarray) -> np.ndarray:
    """(N, 3) its gradient."""
    return np.cos(points @ WAVES.T + PHASES) @ WAVES / len(WAVES)


def cube_sphere(
    cells: int = 24, *, stretch: float = 1.0, touching: bool = False, pose: np.ndarray | None = None
) -> Mesh:
    """A unit sphere made of a cube's six faces, each an island, turned and mirrored in various ways.

    stretch: the power by which the faces' u is bent. touching: no space between the islands.
    """
    grid = np.linspace(-1, 1, cells + 1)
    a, b = np.meshgrid(grid, grid, indexing="ij")
    sides = [np.stack(side, axis=-1) for side in _cube_sides(np.tan(a * np.pi / 4), np.tan(b * np.pi / 4))]
    faces = grid_triangles(*a.shape)
    gap = 0.0 if touching else 0.02
    vertices, triangles, uvs = [], [], []
    for side, points in enumerate(sides):
        u, v = ((a + 1) / 2) ** stretch, (b + 1) / 2
        u, v = (u, v) if side % 2 == 0 else (v, u)
        place = np.stack([(side % 3 + gap + u * (1 - 2 * gap)) / 3, (side // 3 + gap + v * (1 - 2 * gap)) / 2], axis=-1)
        vertices.append(points.reshape(-1, 3) / np.linalg.norm(points, axis=-1).reshape(-1, 1))
        triangles.append(faces + side * a.size)
        uvs.append(place.reshape(-1, 2))
    points, faces = np.concatenate(vertices), np.concatenate(triangles)
    # Corners of neighbouring sides are one vertex, to the last digit.
    _, index, inverse = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    uv = np.concatenate(uvs)[faces]
    faces = inverse.reshape(-1)[faces]
    points = points[index]
    outwards = np.einsum("ti,ti->t", _crosses(points, faces), points[faces].mean(axis=1)) > 0
    faces, uv = np.where(outwards[:, None], faces, faces[:, ::-1]), np.where(outwards[:, None, None], uv, uv[:, ::-1])
    return Mesh(points, faces, points[faces], uv, None, np.eye(4) if pose is None else pose)


def torus(rows: int = 96, columns: int = 48, *, bend: float = 0.0) -> Mesh:
    """A torus of radii 1 and 0.4 about z in one island, whose border is two closed seams; its UVs may lean (`bend`)."""
    i, j = np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    around, about = 2 * np.pi * (i % rows) / rows, 2 * np.pi * (j % columns) / columns
    points = np.stack(
        [(1 + 0.4 * np.cos(about)) * np.cos(around), (1 + 0.4 * np.cos(about)) * np.sin(around), 0.4 * np.sin(about)],
        -1,
    )
    normals = np.stack([np.cos(about) * np.cos(around), np.cos(about) * np.sin(around), np.sin(about)], -1)
    faces = grid_triangles(*i.shape)
    uvs = np.stack([0.03 + 0.94 * ((1 - bend) * i / rows + bend * j / columns), 0.03 + 0.94 * j / columns], -1)
    return Mesh(points.reshape(-1, 3), faces, normals.reshape(-1, 3)[faces], uvs.reshape(-1, 2)[faces])


def tangent_normals(mesh: Mesh, size: int, normal_at: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """(S, S, 3) the tangent-space texture of a surface whose world normals `normal_at` tells for (points, triangles) of
    the mesh; flat where there is no texel."""
    texels = texels_of(mesh.uvs, size)
    normals = normal_at(texels.of(mesh.world_vertices[mesh.triangles]), texels.triangle)
    in_object = normals @ mesh.world_from_object[:3, :3]
    n, t = texels.of(mesh.corner_normals), texels.of(mesh.tangents[..., :3])
    frames = np.stack([t, mesh.tangents[texels.triangle, 0, 3:] * np.cross(n, t), n], axis=-1)
    found = np.linalg.solve(frames.astype(np.float64), in_object[..., None])[..., 0]
    vectors = np.zeros((size, size, 3), np.float32)
    vectors[..., 2] = 1
    vectors[tuple(texels.place.T)] = found / np.linalg.norm(found, axis=1, keepdims=True)
    return vectors


def _cube_sides(a: np.ndarray, b: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    one = np.ones_like(a)
    return [(a, b, one), (a, b, -one), (a, one, b), (a, -one, b), (one, a, b), (-one, a, b)]


def _crosses(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)
