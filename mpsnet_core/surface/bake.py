"""Baking: camera-space normals of one or more views onto the mesh's UVs."""

import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.camera import Camera
from mpsnet_core.errors import InputError
from mpsnet_core.normals import NormalMap, normalised
from mpsnet_core.progress import Progress, silent
from mpsnet_core.rays import RayScene
from mpsnet_core.surface.mesh import Mesh
from mpsnet_core.surface.raster import grown, texel_areas, texel_coordinates, triangle_of_texel
from mpsnet_core.surface.texture import SPACES, Space, Texture
from mpsnet_core.surface.visibility import Visibility

log = logging.getLogger(__name__)

MAX_SIZE = 16384
# Texels worked on at once: small enough to stay in a core's cache.
TEXELS_AT_ONCE = 1 << 16
# Surfaces turned further from the camera than this (cosine) show too few pixels to be trusted.
MIN_FACING = 0.1
# A view counts with the cosine between surface and camera to this power: views from ahead win over glancing ones.
FACING_POWER = 4


@dataclass(frozen=True)
class View:
    """One photo's normals and the camera that took it.

    Raises InputError where the two differ in size.
    """

    camera: Camera
    normals: NormalMap

    def __post_init__(self) -> None:
        height, width = self.normals.mask.shape
        if (self.camera.width, self.camera.height) != (width, height):
            raise InputError(
                f"the camera is {self.camera.width} x {self.camera.height} but its normal map is {width} x {height}; "
                "they must be the same size"
            )


def bake_normals(
    mesh: Mesh,
    views: Sequence[View],
    *,
    size: int = 2048,
    space: Space = "tangent",
    margin: int = 16,
    progress: Progress = silent,
) -> Texture:
    """Bake the views' normals onto the mesh's UVs.

    Every texel takes the mean of the views that see it, weighted by confidence and by how squarely they look at the
    surface. Texels that none sees keep the mesh's own shading normal.

    size: the texture's side in texels. margin: texels that the islands' borders are grown by. space: "tangent" is
    MikkTSpace, "object" the mesh's own axes.

    Raises InputError where there is no view, a number is out of range or no texel is seen; Cancelled where `progress`
    does.
    """
    if not views:
        raise InputError("there is no view to bake; give at least one camera with its normal map")
    if not 1 <= size <= MAX_SIZE:
        raise InputError(f"a texture of {size} texels cannot be baked; choose a size from 1 to {MAX_SIZE}")
    if not 0 <= margin <= size:
        raise InputError(f"a margin of {margin} texels does not fit a texture of {size}; choose 0 to {size}")
    if space not in SPACES:
        raise InputError(f"space {space!r} is not known; choose {' or '.join(SPACES)}")

    progress(0.0, "laying out the UVs")
    scene = RayScene(mesh.world_vertices, mesh.triangles)
    projectors = [_Projector(view, scene) for view in views]
    corners = texel_coordinates(mesh.uvs, size)
    # Where UVs overlap (mirrored halves, say), the triangle that a view sees wins: the last one laid down.
    order = np.argsort(_seen_triangles(mesh, projectors, scene), kind="stable")
    laid = triangle_of_texel(corners[order], size)
    covered = laid >= 0
    if not covered.any():
        raise InputError(f"no texel of a {size} x {size} texture lies on the mesh's UVs; choose a larger size")
    owner = np.where(covered, order[laid], -1)
    _note_layout(mesh, corners, covered)
    surface = _Surface(mesh, corners, scene.middle)

    vectors = np.zeros((size, size, 3), np.float32)
    vectors[..., 2] = 1
    seen = np.zeros((size, size), bool)
    texels = np.flatnonzero(covered)
    starts = range(0, len(texels), TEXELS_AT_ONCE)

    def work(start: int) -> None:
        chunk = texels[start : start + TEXELS_AT_ONCE]
        rows, columns = np.divmod(chunk, size)
        vectors[rows, columns], seen[rows, columns] = _bake_texels(
            surface, projectors, owner.ravel()[chunk], columns, rows, space
        )

    with ThreadPoolExecutor(_usable_cores()) as pool:
        try:
            for done, _ in enumerate(pool.map(work, starts)):
                progress(0.1 + 0.8 * done / len(starts), "baking")
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    if not seen.any():
        raise InputError("no view sees any of the mesh; check that the cameras and the mesh share one world")
    progress(0.9, "growing the margin")
    texture = Texture(grown(vectors, covered, margin), seen, covered, space)
    progress(1.0, "baked")
    return texture


def _seen_triangles(mesh: Mesh, projectors: "Sequence[_Projector]", scene: RayScene) -> NDArray[np.bool_]:
    """(T,) whether any view sees the triangle's middle."""
    corners = mesh.world_vertices[mesh.triangles] - scene.middle
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(mesh.world_from_object[:3, :3]) < 0:
        outwards = -outwards
    middles, outwards = corners.mean(axis=1).astype(np.float32), normalised(outwards).astype(np.float32)
    return np.any([projector.look(middles, outwards)[:, 3] > 0 for projector in projectors], axis=0)


def _note_layout(mesh: Mesh, corners: NDArray[np.float64], covered: NDArray[np.bool_]) -> None:
    """Tell of UVs that a person may not have meant: outside the texture, or over each other."""
    outside = ((mesh.uvs < -1e-4) | (mesh.uvs > 1 + 1e-4)).any(axis=(1, 2))
    if outside.any():
        count = f"{outside.sum()} of {len(mesh.triangles)}"
        log.info("%s triangles have UVs outside 0 to 1, which the texture does not reach", count)
    elif texel_areas(corners).sum() > 1.05 * covered.sum():
        log.info("UVs overlap: where they do, the texture shows the part of the surface that a view sees")


def _usable_cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Surface:
    """What varies linearly over each triangle, as a value at its first corner and steps along texel x and y.

    normal, tangent, position: (T, 3, 3), see :meth:`linear`; positions in the world, relative to `middle`, because far
    from the origin float32 would be too coarse.
    """

    def __init__(self, mesh: Mesh, corners: NDArray[np.float64], middle: NDArray[np.float64]) -> None:
        self.origin = corners[:, 0].astype(np.float32)
        e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
        inverse = np.where(np.abs(area) > 1e-12, 1 / np.where(area == 0, 1, area), 0)
        # Steps of the second and third barycentric coordinate along x and y: (T, 2 coordinates, 2 axes).
        self.steps = inverse[:, None, None] * np.stack(
            [np.stack([e2[:, 1], -e2[:, 0]], -1), np.stack([-e1[:, 1], e1[:, 0]], -1)], axis=1
        )
        self.normal = self.linear(mesh.corner_normals)
        self.tangent = self.linear(mesh.tangents[..., :3])
        self.position = self.linear(mesh.world_vertices[mesh.triangles] - middle)
        self.sign = mesh.tangents[:, 0, 3]
        # Normals are carried to world space by the inverse transpose, and back by the transpose.
        self.object_from_world_normals = mesh.world_from_object[:3, :3].T.astype(np.float32)
        self.world_from_object_normals = np.linalg.inv(mesh.world_from_object[:3, :3]).T.astype(np.float32)

    def linear(self, at_corners: NDArray[np.floating]) -> NDArray[np.float32]:
        """(T, 3, K) corner values as (T, 3, K): the value at the first corner, its step along x, along y."""
        first = at_corners[:, 0]
        differences = np.stack([at_corners[:, 1] - first, at_corners[:, 2] - first], axis=1)
        return np.concatenate(
            [first[:, None], np.einsum("tbk,tba->tak", differences, self.steps)], axis=1, dtype=np.float32
        )


class _Projector:
    """One view, ready to be asked what it sees at points of the surface."""

    def __init__(self, view: View, scene: RayScene) -> None:
        self.camera, self.middle = view.camera, scene.middle
        self.visibility = Visibility(view.camera, scene)
        self.projection = view.camera.projection_rows()
        self.depth = view.camera.depth_row()
        normals = view.normals
        # A little weight where the confidence is zero: a doubtful normal is better than none.
        weight = np.where(normals.mask, np.maximum(normals.confidence, 0.01), 0).astype(np.float32)
        world = normals.vectors @ view.camera.rotation.T.astype(np.float32)
        # (H + 2, W + 2, 4): world normals and a 1, times their weight. The border of nothing spares sampling at the
        # image's edge a special case.
        self.samples = np.pad(
            np.concatenate([world, np.ones_like(world[..., :1])], -1) * weight[..., None], [(1, 1), (1, 1), (0, 0)]
        )

    def look(self, points: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N, 4) the weighted normal in world space and its weight, for surface points and unit normals (N, 3).

        The points are relative to the scene's middle, the normals in world space.
        """
        out = np.zeros((len(points), 4), np.float32)
        if self.camera.projection == "orthographic":
            facing = normals @ self.camera.rotation[:, 2].astype(np.float32)
        else:
            towards = (self.camera.world_from_camera[:3, 3] - self.middle).astype(np.float32) - points
            facing = np.einsum("ni,ni->n", normals, towards) / np.linalg.norm(towards, axis=1)
        candidate = np.flatnonzero(facing > MIN_FACING)
        points = points[candidate] + self.middle
        depth = points @ self.depth[:3] + self.depth[3]
        projected = points @ self.projection[:, :3].T + self.projection[:, 3]
        ahead = (depth > 0) | (self.camera.projection == "orthographic")
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = projected[:, :2] / projected[:, 2:]
        inside = (
            ahead
            & (pixels > -0.5).all(axis=1)
            & (pixels < [self.camera.width + 0.5, self.camera.height + 0.5]).all(axis=1)
        )
        candidate, points, pixels, depth = candidate[inside], points[inside], pixels[inside], depth[inside]
        sampled = self._sample(pixels)
        hit = sampled[:, 3] > 0
        candidate, sampled = candidate[hit], sampled[hit]
        visible = self.visibility.seen(points[hit], pixels[hit], depth[hit])
        out[candidate[visible]] = sampled[visible] * (facing[candidate[visible]] ** FACING_POWER)[:, None]
        return out

    def _sample(self, pixels: NDArray[np.float64]) -> NDArray[np.float32]:
        """Bilinear, between pixel centres; pixels outside the mask take no part."""
        place = pixels + 0.5  # the border adds one pixel, pixel centres stand at one half
        corner = np.floor(place).astype(np.int64)
        x, y = (place - corner).astype(np.float32).T[..., None]
        stride = self.samples.shape[1]
        index = corner[:, 1] * stride + corner[:, 0]
        flat = self.samples.reshape(-1, 4)
        above = flat[index] * (1 - x) + flat[index + 1] * x
        below = flat[index + stride] * (1 - x) + flat[index + stride + 1] * x
        result: NDArray[np.float32] = above * (1 - y) + below * y
        return result


def _bake_texels(
    surface: _Surface,
    projectors: Sequence[_Projector],
    triangles: NDArray[np.int32],
    columns: NDArray[np.int64],
    rows: NDArray[np.int64],
    space: Space,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(N, 3) unit normals in `space` and (N,) whether any view saw the texel."""
    x = (columns - surface.origin[triangles, 0]).astype(np.float32)[:, None]
    y = (rows - surface.origin[triangles, 1]).astype(np.float32)[:, None]

    def at_texels(linear: NDArray[np.float32]) -> NDArray[np.float32]:
        value = linear[triangles]
        result: NDArray[np.float32] = value[:, 0] + value[:, 1] * x + value[:, 2] * y
        return result

    normal = at_texels(surface.normal)
    points = at_texels(surface.position)
    facing_out = normalised(normal @ surface.world_from_object_normals.T)
    total = sum(projector.look(points, facing_out) for projector in projectors)
    seen = np.asarray(total)[:, 3] > 0
    baked = np.where(seen[:, None], np.asarray(total)[:, :3] @ surface.object_from_world_normals.T, normal)
    if space == "tangent":
        baked = _to_tangent_space(baked, normal, at_texels(surface.tangent), surface.sign[triangles])
    return normalised(baked), seen


def _to_tangent_space(
    vectors: NDArray[np.float32],
    normal: NDArray[np.float32],
    tangent: NDArray[np.float32],
    sign: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Solve ``v = x T + y B + z N`` up to scale, with the interpolated T and N as they are and B = sign N x T.

    Renderers interpolate T and N without making them perpendicular again; the inverse of what they do is exact.
    """
    bitangent = np.cross(normal, tangent) * sign[:, None]
    volume = np.einsum("ni,ni->n", tangent, np.cross(bitangent, normal))
    inverse = np.stack([np.cross(bitangent, normal), np.cross(normal, tangent), np.cross(tangent, bitangent)], axis=1)
    return np.einsum("nij,nj->ni", inverse, vectors) * np.sign(volume)[:, None]
