"""UDIM tiles joined in one texture, to solve for all of them at once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mpsnet_core.arrays.types import F32, I64
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.relief.sizes import MAX_SIZE, check_square
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture_sets import TextureSet


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
