"""Baking: camera-space normals of one or more views onto the mesh's UVs."""

import logging
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.normals import normalised
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.rays import RayScene
from mpsnet_core.surface.mesh import Mesh
from mpsnet_core.surface.projection import Projector, View
from mpsnet_core.surface.raster import grown, texel_areas, texel_coordinates, triangle_of_texel
from mpsnet_core.surface.texture import SPACES, Space, Texture

log = logging.getLogger(__name__)

MAX_SIZE = 16384
# Texels worked on at once: small enough to stay in a core's cache.
TEXELS_AT_ONCE = 1 << 16
# Views beyond about this much memory are not held at once, but asked for again in each pass.
HELD_BYTES = 1 << 30
MAX_STRENGTH = 2.0
# The weight of the mesh's own normal where views fade out: that of a view at 80 degrees.
FADE = 1e-3


def bake_normals(
    mesh: Mesh,
    views: Sequence[View],
    *,
    size: int = 2048,
    space: Space = "tangent",
    margin: int = 16,
    feather: float = 0.0,
    strength: float = 1.0,
    progress: Progress = silent,
) -> Texture:
    """Bake the views' normals onto the mesh's UVs.

    Every texel takes the mean of the views that see it, weighted by confidence and by how squarely they look at the
    surface. Texels that none sees keep the mesh's own shading normal.

    views: asked for one after the other, and more than once where they are too large to be held all at once.
    size: the texture's side in texels. margin: texels that the islands' borders are grown by. space: "tangent" is
    MikkTSpace, "object" the mesh's own axes. feather: a share of the mesh's size; over this distance each view fades
    out towards its borders (:mod:`mpsnet_core.surface.feather`), into the others or into the mesh's own normals.
    strength: what the slopes against the mesh's own normals are multiplied by; 0 leaves nothing of the views.

    Raises InputError where there is no view, a number is out of range or no texel is seen; Cancelled where `progress`
    does.
    """
    if not len(views):
        raise InputError("there is no view to bake; give at least one camera with its normal map")
    check_texture(size, space, margin)
    if not 0 <= feather <= 1:
        raise InputError(f"a feather of {feather:g} times the mesh's size cannot be baked; choose 0 to 1")
    check_strength(strength)

    progress(0.0, "laying out the UVs")
    scene = RayScene(mesh.world_vertices, mesh.triangles)
    projectors = _Projectors(views, scene, feather)
    corners = texel_coordinates(mesh.uvs, size)
    # Where UVs overlap (mirrored halves, say), the triangle that a view sees wins: the last one laid down.
    order = np.argsort(_seen_triangles(mesh, projectors, scene, part(progress, 0.0, 0.1)), kind="stable")
    laid = triangle_of_texel(corners[order], size)
    covered = laid >= 0
    if not covered.any():
        raise InputError(f"no texel of a {size} x {size} texture lies on the mesh's UVs; choose a larger size")
    _note_layout(mesh, corners, covered)
    texels = np.flatnonzero(covered)
    surface = _Surface(mesh, corners, scene.middle, order[laid.ravel()[texels]], texels, size)
    del laid

    looks = _Looks.none(len(texels))
    vectors = np.zeros((size * size, 3), np.float32)
    vectors[:, 2] = 1
    spread = np.zeros(size * size, np.float32)
    starts = range(0, len(texels), TEXELS_AT_ONCE)
    done = 0
    with ThreadPoolExecutor(_usable_cores()) as pool:
        try:
            for batch in projectors.batches():
                last = done + len(batch) * len(starts) == len(views) * len(starts)

                def work(start: int, batch: list[Projector] = batch, last: bool = last) -> None:
                    chunk = slice(start, start + TEXELS_AT_ONCE)
                    point, normal = surface.points(chunk)
                    looked = looks.of(chunk)
                    for projector in batch:
                        looked.add(*projector.look(point, normal))
                    if last:
                        fallback = normal * np.float32(FADE * (feather > 0))
                        vectors[texels[chunk]] = surface.encoded(chunk, looked.sums[:, :3] + fallback, space, strength)
                        spread[texels[chunk]] = looked.spread()

                for _ in pool.map(work, starts):
                    progress(0.1 + 0.8 * done / (len(views) * len(starts)), "baking")
                    done += len(batch)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    if not looks.views.any():
        raise InputError("no view sees any of the mesh; check that the cameras and the mesh share one world")
    progress(0.9, "growing the margin")
    count = np.zeros(size * size, np.uint16)
    count[texels] = looks.views
    shape = (size, size)
    texture = Texture(
        grown(vectors.reshape(*shape, 3), covered, margin),
        (count > 0).reshape(shape),
        covered,
        space,
        count.reshape(shape),
        spread.reshape(shape),
    )
    progress(1.0, "baked")
    return texture


def check_texture(size: int, space: str, margin: int) -> None:
    """Raises InputError where :func:`bake_normals` would bake no texture of that size, space and margin."""
    if not 1 <= size <= MAX_SIZE:
        raise InputError(f"a texture of {size} texels cannot be baked; choose a size from 1 to {MAX_SIZE}")
    if not 0 <= margin <= size:
        raise InputError(f"a margin of {margin} texels does not fit a texture of {size}; choose 0 to {size}")
    if space not in SPACES:
        raise InputError(f"space {space!r} is not known; choose {' or '.join(SPACES)}")


def check_strength(strength: float) -> None:
    """Raises InputError where :func:`bake_normals` would bake no detail of that strength."""
    if not 0 <= strength <= MAX_STRENGTH:
        raise InputError(f"a strength of {strength:g} cannot be baked; choose 0 to {MAX_STRENGTH:g}")


class _Projectors:
    """The views' projectors, as many at once as memory shall hold; all of them kept where that is enough."""

    def __init__(self, views: Sequence[View], scene: RayScene, feather: float) -> None:
        self.views, self.scene, self.feather = views, scene, feather
        self.all: list[Projector] = []

    def batches(self) -> Iterator[list[Projector]]:
        if self.all:
            yield self.all
            return
        batch: list[Projector] = []
        held = 0
        for number in range(len(self.views)):
            batch.append(Projector(self.views[number], self.scene, self.feather))
            held += _held_bytes(batch[-1])
            if number + 1 == len(self.views) == len(batch):
                self.all = batch
            if held >= HELD_BYTES or number + 1 == len(self.views):
                yield batch
                batch, held = [], 0


def _held_bytes(projector: Projector) -> int:
    """What its images take up: the normals and the depth image."""
    arrays = [*vars(projector).values(), *vars(projector.visibility).values()]
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


@dataclass(frozen=True)
class _Looks:
    """What the views so far say of N texels.

    sums: (N, 4) their weighted normals in world space, and those vectors' lengths. views: (N,) how many see the texel.
    """

    sums: NDArray[np.float32]
    views: NDArray[np.uint16]

    @classmethod
    def none(cls, count: int) -> "_Looks":
        return cls(np.zeros((count, 4), np.float32), np.zeros(count, np.uint16))

    def of(self, chunk: slice) -> "_Looks":
        """Some of the texels; what is added to them is added here."""
        return _Looks(self.sums[chunk], self.views[chunk])

    def add(self, seen: NDArray[np.int64], samples: NDArray[np.float32]) -> None:
        """Add what one more view says, see :meth:`Projector.look`."""
        samples[:, 3] = np.sqrt(np.einsum("ni,ni->n", samples[:, :3], samples[:, :3]))
        self.sums[seen] += samples
        self.views[seen] += 1

    def spread(self) -> NDArray[np.float32]:
        """(N,) degrees: the angle whose cosine is the weighted mean cosine between the views' normals and their mean.

        That mean cosine is the weighted sum's length over the sum of the lengths.
        """
        spread = np.zeros(len(self.views), np.float32)
        several = np.flatnonzero(self.views > 1)
        sums = self.sums[several].astype(np.float64)
        cosine = np.linalg.norm(sums[:, :3], axis=1) / sums[:, 3]
        spread[several] = np.degrees(np.arccos(np.minimum(cosine, 1)))
        return spread


def _seen_triangles(mesh: Mesh, projectors: _Projectors, scene: RayScene, progress: Progress) -> NDArray[np.bool_]:
    """(T,) whether any view sees the triangle's middle."""
    corners = mesh.world_vertices[mesh.triangles] - scene.middle
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if np.linalg.det(mesh.world_from_object[:3, :3]) < 0:
        outwards = -outwards
    middles, outwards = corners.mean(axis=1).astype(np.float32), normalised(outwards).astype(np.float32)
    seen = np.zeros(len(middles), bool)
    for batch in projectors.batches():
        progress(0.0, "laying out the UVs")
        for projector in batch:
            seen[projector.look(middles, outwards)[0]] = True
    return seen


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
    """The surface under N texels: linear over each triangle, a value at its first corner and steps along texel x and y.

    normal, tangent, position: (T, 3, 3), see :meth:`linear`; positions in the world, relative to `middle`, because far
    from the origin float32 would be too coarse. triangle, texels: (N,) what lies under which texels of the texture,
    numbered row by row.
    """

    def __init__(
        self,
        mesh: Mesh,
        corners: NDArray[np.float64],
        middle: NDArray[np.float64],
        triangle: NDArray[np.integer],
        texels: NDArray[np.integer],
        size: int,
    ) -> None:
        self.triangle, self.texels, self.size = triangle, texels, size
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

    def at(self, chunk: slice, *layers: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """(M, K) values of :meth:`linear`'s layers at some of the texels."""
        triangle = self.triangle[chunk]
        rows, columns = np.divmod(self.texels[chunk], self.size)
        x = (columns - self.origin[triangle, 0]).astype(np.float32)[:, None]
        y = (rows - self.origin[triangle, 1]).astype(np.float32)[:, None]
        values = (layer[triangle] for layer in layers)
        return [value[:, 0] + value[:, 1] * x + value[:, 2] * y for value in values]

    def points(self, chunk: slice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(M, 3) points, and (M, 3) unit shading normals in world space."""
        position, normal = self.at(chunk, self.position, self.normal)
        return position, normalised(normal @ self.world_from_object_normals.T)

    def encoded(self, chunk: slice, vectors: NDArray[np.float32], space: Space, strength: float) -> NDArray[np.float32]:
        """(M, 3) unit normals in `space` from vectors (M, 3) in world space; the surface's own where those are zero."""
        normal, tangent = self.at(chunk, self.normal, self.tangent)
        baked = np.where(vectors.any(axis=1)[:, None], vectors @ self.object_from_world_normals.T, normal)
        if strength != 1:
            own = normalised(normal)
            along = np.einsum("ni,ni->n", baked, own)[:, None] * own
            baked = along + np.float32(strength) * (baked - along)
        if space == "tangent":
            baked = _to_tangent_space(baked, normal, tangent, self.sign[self.triangle[chunk]])
        return normalised(baked)


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
