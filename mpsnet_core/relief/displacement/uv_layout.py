"""A mesh's layout in a texture: the triangle under each texel, and the texels that meet at the seams."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mpsnet_core.arrays.rasterize import NO_AREA, texel_areas, texel_coordinates, triangle_of_texel
from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools, Floats
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.relief.height_map import MAX_SIZE, check_square
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture_sets import Islands, TextureSet, islands_of

# Triangles below this fraction of the largest area are degenerate, apart from rounding.
MIN_AREA = 1e-12
# Seams are sampled up to so many texels beside the texture, and at no more points than this in all.
BESIDE = 2
MAX_SAMPLES = 1 << 23


@dataclass(frozen=True)
class Layout:
    """A mesh's layout in a texture of S x S texels.

    Where islands overlap, only one of them is used in the whole overlap.
    """

    mesh: Mesh
    """The mesh, with T triangles."""
    corners: F64
    """(T, 3, 2) float64. Texel coordinates of the triangles' corners."""
    triangle: I32
    """(S, S) int32. The triangle that covers each texel, -1 for none."""
    island: I32
    """(S, S) int32. The UV island that covers each texel, -1 for none."""
    islands: Islands
    """The mesh's UV islands."""

    def at(self, rows: slice, *layers: Floats) -> list[F64]:
        """(h, S, K) corner values (T, 3, K), interpolated linearly over each triangle, at some rows of texels; 0 where
        there is no triangle."""
        triangle = self.triangle[rows]
        covered = triangle >= 0
        row, column = np.nonzero(covered)
        hit_triangles = triangle[covered]
        corners = self.corners[hit_triangles]
        x, y = column - corners[:, 0, 0], row + rows.start - corners[:, 0, 1]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        area = ax * by - ay * bx
        second, third = (x * by - y * bx) / area, (ax * y - ay * x) / area
        weights = np.stack([1 - second - third, second, third], axis=-1)
        found = []
        for layer in layers:
            values = np.zeros((*triangle.shape, layer.shape[-1]))
            values[covered] = np.einsum("nc,nck->nk", weights, layer[hit_triangles])
            found.append(values)
        return found

    def areas(self) -> F64:
        """(T,) area of a texel on each triangle, in world units."""
        return self.mesh.world_areas / np.maximum(texel_areas(self.corners), NO_AREA)

    def seams(self) -> "Seams":
        """Sample points along the seams, about a texel apart, where one of a seam's sides is in the texture.

        Raises GeometryError if there are too many.
        """
        size = len(self.island)
        ends = texel_coordinates(self.islands.seam_uvs, size)
        first, last, count = _samples_within(ends, size)
        seam = np.repeat(np.arange(len(count)), count)
        before = np.cumsum(count) - count
        share = (np.arange(len(seam)) - before[seam] + 0.5) / count[seam]
        along = (first[seam] + share * (last - first)[seam])[:, None, None]
        places = ends[seam, :, 0] * (1 - along) + ends[seam, :, 1] * along
        islands = self.islands.seam_islands[seam]
        texels = np.full((len(seam), 2), -1, np.int64)
        offsets, nearest = np.zeros((len(seam), 2, 2)), np.full((len(seam), 2), np.inf)
        for row, column in np.ndindex(4, 4):
            texel = np.floor(np.clip(places, -4, size + 4)).astype(np.int64) + np.array([column - 1, row - 1])
            inside = ((texel >= 0) & (texel < size)).all(axis=-1)
            x, y = np.moveaxis(np.clip(texel, 0, size - 1), -1, 0)
            offset = places - texel
            distances = np.linalg.norm(offset, axis=-1)
            nearer = inside & (self.island[y, x] == islands) & (distances < nearest)
            texels[nearer], offsets[nearer], nearest[nearer] = (y * size + x)[nearer], offset[nearer], distances[nearer]
        number = np.cumsum(self.triangle >= 0) - 1
        return Seams(places, np.where(texels >= 0, number[texels], -1).astype(np.int32), offsets)


def _samples_within(ends: F64, size: int) -> tuple[F64, F64, I64]:
    """For each seam the interval, within 0 to 1, in which a side is in the texture, and its number of sample points.

    ends: (M, 2 sides, 2 ends, 2) texel coordinates.
    """
    start, delta = ends[:, :, 0], ends[:, :, 1] - ends[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        crossings = np.stack([-BESIDE - start, size - 1 + BESIDE - start]) / delta
        still = (start >= -BESIDE) & (start <= size - 1 + BESIDE)  # along an axis in which the side does not move
        crossings = np.where(delta == 0, np.where(still, [[[[-np.inf]]], [[[np.inf]]]], np.inf), crossings)
        first = np.clip(crossings.min(axis=0).max(axis=-1), 0, 1)
        last = np.clip(crossings.max(axis=0).min(axis=-1), 0, 1)
        inside = first < last
        lengths = np.where(inside, (last - first) * np.hypot(delta[..., 0], delta[..., 1]), 0)
        first, last = np.where(inside, first, 1).min(axis=1), np.where(inside, last, 0).max(axis=1)
        count = np.ceil(lengths.max(axis=1))
    if not count.sum() <= MAX_SAMPLES:
        raise GeometryError("the UVs of the mesh's seams reach far beyond the texture; unwrap the mesh again")
    return first, last, count.astype(np.int64)


@dataclass(frozen=True)
class Seams:
    """M sample points along the seams, and the texels next to them."""

    places: F64
    """(M, 2, 2) float64. Texel coordinates of each point on either side of the seam."""
    texels: I32
    """(M, 2) int32. The nearest covered texel on each side, as an index among all covered texels in row-major order; -1
    on islands that are too small to cover one there."""
    offsets: F64
    """(M, 2, 2) float64. Offset of the point, right and down in texels, from that texel's centre."""

    @property
    def met(self) -> Bools:
        """(M,) whether both sides cover a texel, and not the same one."""
        return (self.texels >= 0).all(axis=1) & (self.texels[:, 0] != self.texels[:, 1])


def layout_of(mesh: Mesh, size: int) -> Layout:
    """Lay out a mesh in a texture of `size` x `size` texels. Triangles without area cover none."""
    islands = islands_of(mesh)
    corners = texel_coordinates(mesh.uvs, size)
    areas = mesh.world_areas
    order = np.argsort(islands.of_triangle, kind="stable").astype(np.int32)
    order = order[areas[order] > MIN_AREA * areas.max()]
    laid = triangle_of_texel(corners[order], size)
    triangle = np.where(laid >= 0, order[laid], np.int32(-1))
    island = np.where(laid >= 0, islands.of_triangle[triangle], np.int32(-1))
    return Layout(mesh, corners, triangle, island, islands)


# ----------------------------------------------------------------------------------------------------------------------
# UDIM tiles joined in one texture, to solve for all of them at once.


@dataclass(frozen=True)
class Tiles:
    """UDIM tiles, arranged in a texture of `side` x `side` squares, starting at the lower left."""

    corners: I64
    """(N, 2) int64. The tiles' lower left corners in UV space."""

    @property
    def side(self) -> int:
        return int(np.ceil(np.sqrt(len(self.corners))))

    def mesh(self, mesh: Mesh) -> Mesh:
        """The mesh with its UVs in that texture. Triangles in none of the tiles lie outside it."""
        of_triangle = np.floor(mesh.uvs.mean(axis=1, dtype=np.float64)).astype(np.int64)
        uvs = np.full(mesh.uvs.shape, -1.0)
        for number, corner in enumerate(self.corners):
            inside = (of_triangle == corner).all(axis=1)
            row, column = divmod(number, self.side)
            uvs[inside] = (mesh.uvs[inside] - corner + (column, row)) / self.side
        # Tangents are those of the original UVs, which may be connected across a tile's border.
        return replace(mesh, uvs=uvs, given_tangents=mesh.tangents)

    def joined(self, textures: Iterable[F32]) -> F32:
        """(side S, side S, K) the tiles' textures (S, S, K) joined, read one by one; 0 where there is no tile.

        Raises InputError if they differ in size, are not square, or are too large together.
        """
        ahead = iter(textures)
        first = next(ahead)
        height, width, *more = first.shape
        check_square(height, width)
        if self.side > 1 and height * self.side > MAX_SIZE:
            raise SettingsError(
                f"{len(self.corners)} tiles of {height} texels a side are too many for heights on UVs; bake them with "
                f"{MAX_SIZE // self.side} at most"
            )
        whole = np.zeros((height * self.side, width * self.side, *more), np.float32)
        for place, texture in zip(self._places(height), chain([first], ahead), strict=True):
            if texture.shape != first.shape:
                sizes = " and ".join(f"{w} x {h}" for h, w, *_ in sorted((first.shape, texture.shape)))
                raise GeometryError(f"the tiles' textures have several sizes, {sizes}; bake them all with one")
            whole[place] = texture
        return whole

    def parted(self, whole: F32) -> list[F32]:
        """Each tile's part (S, S, ...) of the texture (side S, side S, ...)."""
        return [whole[place] for place in self._places(len(whole) // self.side)]

    def _places(self, size: int) -> list[tuple[slice, slice]]:
        places = []
        for number in range(len(self.corners)):
            row, column = divmod(number, self.side)
            top = self.side - 1 - row
            places.append((slice(top * size, (top + 1) * size), slice(column * size, (column + 1) * size)))
        return places


def tiles_of(texture_sets: Sequence[TextureSet]) -> Tiles:
    """The tiles of :func:`mpsnet_core.scene.texture_sets.texture_sets`."""
    return Tiles(np.array([texture_set.corner for texture_set in texture_sets], np.int64))
