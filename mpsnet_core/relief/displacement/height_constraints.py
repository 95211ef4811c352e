"""Constraints of baked normals on heights over a mesh's UVs: the change from each texel to the next."""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.graph_poisson import Graph
from mpsnet_core.arrays.mask_regions import box_sums, eroded
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import GeometryError
from mpsnet_core.progress import Progress
from mpsnet_core.relief.displacement.uv_layout import Layout, layout_of
from mpsnet_core.scene.mesh import Mesh, shared_normals
from mpsnet_core.scene.normal_map import OUTWARDS_SHARE
from mpsnet_core.scene.texture import Space
from mpsnet_core.scene.texture_sets import welded

# Gradients steeper than this (cosine of the angle between the surface and the mesh; 80°) are limited to it: a normal
# perpendicular to the mesh's would require an infinite height. The limit is lower than that of integration over a
# photo (gradients.MIN_FACING): here steep texels have the same weight as all others, and a surface that bends away
# further is no height field over its mesh.
MIN_FACING = 0.17
# Normals within this distance of the mesh's own count as equal, at eight bits per channel. A texel is unseen if its
# neighbours within this many texels are equal, too.
SAME = 0.007
AROUND = 2
ROWS = 64


@dataclass(frozen=True)
class HeightDifferences:
    """For N covered texels, h_j - h_i = -(flat + curved (h_i + h_j) / 2) to the neighbours j on the right and below."""

    flat: F32
    """(2, N) float32. In world units; meaningless where there is no neighbour."""
    curved: F32
    """(2, N) float32. Per unit of height; meaningless where there is no neighbour."""
    outwards: F32
    """(N,) float32. Distance in world units by which the mesh of the normals lies outside the displaced one; 0 if they
    are the same."""

    def changes(self, graph: Graph, heights: F32) -> tuple[F32, F32]:
        """(N,) the changes to the neighbours on the right and below, given approximate `heights`."""
        right, below = (
            -(self.flat[axis] + self.curved[axis] * (heights + heights[graph.neighbours[axis]]) / 2) for axis in (0, 1)
        )
        return right, below


def slope_constraints(
    vectors: F32, seen: F32, space: Space, own: Layout, base: Layout, shaded: bool, progress: Progress
) -> HeightDifferences:
    """Constraints on heights over the mesh of `base` from normals `vectors` (S, S, 3) baked onto the mesh of `own`.

    seen: (S, S) weight of the normals, from 0 (the mesh's own smooth normals apply) to 1. shaded: heights are relative
    to a surface with the mesh's shading normals, which keeps smooth-shaded facets as they are; else to the facets.

    The displaced surface is s = p + h n, with n the base's smooth unit normals. Its chord s_j - s_i is perpendicular to
    m, the mean of the target normals at its two ends (exactly so on a sphere, a cylinder and a plane):
    m·(p_j - p_i) + h_j m·n_j - h_i m·n_i = 0.

    Raises GeometryError if many of the normals point into the mesh, as they do in the wrong space.
    """
    size = len(base.triangle)
    numbers = np.cumsum(np.concatenate([[0], (base.triangle >= 0).sum(axis=1)]))
    flat, curved = np.zeros((2, 2, numbers[-1]), np.float32)
    outwards = np.zeros(numbers[-1], np.float32)
    facing_out = 0
    middle = base.mesh.world_vertices.mean(axis=0)
    surface, shading = _surface(base, middle), _shading(own)
    own_surface = surface if own is base else _surface(own, middle)
    for rows in bands(size, ROWS):
        progress(rows.start / size, "reading the normals")
        more = slice(rows.start, min(rows.stop + 1, size))
        point, normal = base.at(more, *surface)
        normal = normalised(normal)
        tangent, upright, sign = own.at(more, *shading)
        wanted = _wanted(vectors[more], seen[more], space, own, (tangent, upright, sign))
        upright = _to_world(own, upright)
        if own is not base:
            wanted = np.where((own.triangle[more] >= 0)[..., None], wanted, normal)
        here, inside = slice(numbers[rows.start], numbers[rows.stop]), base.triangle[rows] >= 0
        facing_out += int(np.count_nonzero(dot(wanted, normal)[: len(inside)][inside] >= 0))
        for number, axis in enumerate((1, 0)):
            step, turn = _to_neighbour(point, normal, wanted, upright if shaded else None, axis)
            flat[number, here] = step[: len(inside)][inside]
            curved[number, here] = turn[: len(inside)][inside]
        if own is not base:
            (own_point,) = own.at(rows, own_surface[0])
            apart = dot(own_point - point[: len(inside)], normal[: len(inside)])
            outwards[here] = np.where(own.triangle[rows] >= 0, apart, 0)[inside]
    if facing_out < OUTWARDS_SHARE * numbers[-1]:
        raise GeometryError(
            f"the texture does not fit the mesh in {space} space: many of its normals point inwards; give the space "
            "that it was baked in, and the mesh that it was baked onto"
        )
    return HeightDifferences(flat, curved, outwards)


def _to_neighbour(
    point: Floats, normal: Floats, wanted: Floats, upright: Floats | None, axis: int
) -> tuple[Floats, Floats]:
    """The chord to the next texel along an axis, and the difference of the normals, relative to the mean target normal.

    upright: shading normals that the heights are relative to, None for the facets.
    """
    # np.roll wraps around at the last column and row, but there is no neighbour there.
    towards = wanted + np.roll(wanted, -1, axis)
    chord = np.roll(point, -1, axis) - point
    if upright is not None:
        mean = normalised(upright + np.roll(upright, -1, axis))
        chord -= dot(chord, mean)[..., None] * mean
    first, second = dot(towards, normal), dot(towards, np.roll(normal, -1, axis))
    least = np.maximum(MIN_FACING * np.linalg.norm(towards, axis=-1), 1e-6)
    facing = np.maximum((first + second) / 2, least)
    return dot(towards, chord) / facing, (second - first) / facing


def _surface(layout: Layout, middle: F64) -> list[F64]:
    """(T, 3, 3) the corners' positions in world space, relative to `middle`, and their smooth normals."""
    mesh = layout.mesh
    points = (mesh.world_vertices - middle)[mesh.triangles]
    normals = shared_normals(points, welded(mesh))
    return [points, -normals if mesh.is_mirrored else normals]


def _shading(layout: Layout) -> list[Floats]:
    """(T, 3, 3) tangents and shading normals of the corners, and (T, 3, 1) the bitangents' signs."""
    mesh = layout.mesh
    return [mesh.tangents[..., :3], mesh.corner_normals, np.repeat(mesh.tangents[:, :1, 3:], 3, axis=1)]


def _wanted(vectors: F32, seen: F32, space: Space, own: Layout, shading: tuple[F64, F64, F64]) -> F64:
    """(h, S, 3) target unit normals in world space for some rows of the texture. shading: of these rows, see
    :func:`_shading`."""
    tangent, normal, sign = shading
    wanted = vectors.astype(np.float64)
    if space == "tangent":
        wanted = _from_tangent_space(wanted, tangent, normal, sign)
    weight = seen[..., None]
    mixed = weight * normalised(wanted) + (1 - weight) * normalised(normal)
    return _to_world(own, mixed)


def _to_world(own: Layout, normals: F64) -> F64:
    return normalised(normals @ own.mesh.normals_to_world)


def _from_tangent_space(vectors: F64, tangent: F64, normal: F64, sign: F64) -> F64:
    """(h, S, 3) tangent-space `vectors` in object space, not normalised."""
    x, y, z = np.moveaxis(vectors, -1, 0)[..., None]
    return x * tangent + y * sign * np.cross(normal, tangent) + z * normal


def object_normals(vectors: F32, mesh: Mesh, margin: int) -> F32:
    """(S, S, 3) an object-space texture that shades any surface near the mesh as the tangent-space texture `vectors`
    (S, S, 3) shades the mesh. margin: texels by which the UV islands are dilated."""
    own = layout_of(mesh, len(vectors))
    shading, covered = _shading(own), own.triangle >= 0
    found = np.zeros(vectors.shape, np.float32)
    for rows in bands(len(vectors), ROWS):
        found[rows] = normalised(_from_tangent_space(vectors[rows].astype(np.float64), *own.at(rows, *shading)))
    found[~covered] = 0, 0, 1
    return extend_to_nearest(found, covered, margin, in_place=True)


def seen_share(vectors: F32, space: Space, own: Layout, fade: float) -> F32:
    """(S, S) from 0 where no view saw the surface, rising to 1 at the distance `fade` (world units) from there.

    Unseen texels have the mesh's own normals. Normals near them were seen at grazing angles and have the largest
    errors.
    """
    flat = np.ones(vectors.shape[:2], bool)
    shading = _shading(own)[1]
    for rows in bands(len(flat), ROWS):
        normal = normalised(own.at(rows, shading)[0]) if space == "object" else np.array([0.0, 0.0, 1.0])
        flat[rows] = np.linalg.norm(vectors[rows] - normal, axis=-1) < SAME
    covered = own.triangle >= 0
    unseen = eroded(flat | ~covered, AROUND) & covered  # a single texel may be equal by chance
    texel = np.sqrt(own.areas()[own.triangle[covered]].mean())
    reach = int(np.clip(fade / texel, 1, len(flat) // 8))
    # At a straight border, half of the neighbourhood is unseen: twice its fraction is 1.
    around, of_those = (box_sums(inside.astype(np.float32), reach) for inside in (covered, unseen))
    share = 2 * of_those / np.maximum(around, 1)
    return np.where(unseen, 0, np.clip(1 - share, 0, 1)).astype(np.float32)
