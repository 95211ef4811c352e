"""Accumulation of the views' samples at points of the surface, with as many views in memory as fit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bake.projection import Projector, View
from mpsnet_core.bake.texel_surface import SurfacePoints
from mpsnet_core.errors import GeometryError
from mpsnet_core.progress import Progress
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.texture import Texture

# Bytes of views held in memory at once, approximately. If there are more, they are read again in each pass.
HELD_BYTES = 1 << 29


class Projectors:
    """The views' projectors in batches that fit into memory. If one batch holds all of them, it is kept."""

    def __init__(self, views: Sequence[View], scene: RayScene, feather: float) -> None:
        self.views, self.scene, self.feather = views, scene, feather
        self.all: list[Projector] = []
        # Number of values per sample, see `Projector.sample_points`; known once views were read.
        self.values = 0
        # Largest expected error of a view in degrees, known in the same way.
        self.expected_error = 0.0

    def batches(self) -> Iterator[list[Projector]]:
        """Yield all projectors in the views' order, in batches of about HELD_BYTES. A batch is freed before the next.

        Raises InputError if a view that is not held in memory cannot be read again, or only some have colours.
        """
        if self.all:
            yield self.all
            return
        batch: list[Projector] = []
        bytes_in_memory = 0
        for number in range(len(self.views)):
            batch.append(Projector(self.views[number], self.scene, self.feather))
            values = batch[-1].samples.shape[2]
            if self.values not in (0, values):
                raise GeometryError(
                    "some views have colours and others none; give colours for all of them, or for none"
                )
            self.values = values
            self.expected_error = max(self.expected_error, batch[-1].expected_error)
            size = _held_bytes(batch[-1])
            bytes_in_memory += size
            if number + 1 == len(self.views) == len(batch):
                self.all = batch
            # Reading the next view takes about as much memory as this one holds.
            if bytes_in_memory + size >= HELD_BYTES or number + 1 == len(self.views):
                yield batch
                if batch is self.all:
                    return
                batch.clear()  # a caller that keeps the list keeps no view in memory
                bytes_in_memory = 0


def _held_bytes(projector: Projector) -> int:
    """Bytes of its arrays: the samples and the depth image."""
    arrays = [*vars(projector).values(), *vars(projector.visibility).values()]
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


@dataclass(frozen=True)
class ViewAccumulator:
    """Running sums over views at N texels."""

    sums: NDArray[np.float32]
    """(N, 4). Weighted normals in world space, and the lengths of these vectors; with colours (N, 8), weighted colours
    and their weights follow."""
    views: NDArray[np.uint16]
    """(N,). Number of views that see the texel."""

    @classmethod
    def none(cls, count: int, values: int) -> "ViewAccumulator":
        """Zero sums for `count` texels. values: number of values per sample."""
        return cls(np.zeros((count, values), np.float32), np.zeros(count, np.uint16))

    @classmethod
    def kept(cls, texture: Texture, texels: NDArray[np.int64]) -> "ViewAccumulator":
        """The sums that :meth:`keep` stored in a texture, at the texels of these flat indices."""
        assert texture.spread is not None and texture.views is not None
        sums = [texture.vectors.reshape(-1, 3).take(texels, axis=0), texture.spread.reshape(-1, 1).take(texels, axis=0)]
        if texture.colours is not None:
            sums.append(texture.colours.reshape(-1, 4).take(texels, axis=0))
        return cls(np.concatenate(sums, axis=1), texture.views.ravel().take(texels))

    def keep(self, texture: Texture, texels: NDArray[np.int64]) -> None:
        """Store the sums in the texture that will be made from them: there is not enough memory for both."""
        assert texture.spread is not None and texture.views is not None
        texture.vectors.reshape(-1, 3)[texels] = self.sums[:, :3]
        texture.spread.ravel()[texels] = self.sums[:, 3]
        texture.views.ravel()[texels] = self.views
        if texture.colours is not None:
            texture.colours.reshape(-1, 4)[texels] = self.sums[:, 4:]

    def add(self, seen: NDArray[np.int64], samples: NDArray[np.float32]) -> None:
        """Add one view's samples from :meth:`Projector.sample_points`."""
        x, y, z = samples[:, 0], samples[:, 1], samples[:, 2]
        samples[:, 3] = np.sqrt(x * x + y * y + z * z)
        samples += self.sums.take(seen, axis=0)
        self.sums[seen] = samples
        self.views[seen] = self.views.take(seen) + np.uint16(1)

    def spread(self) -> NDArray[np.float32]:
        """(N,) degrees: the angle whose cosine is the weighted mean cosine between the views' normals and their mean.

        That mean cosine is the weighted sum's length over the sum of the lengths.
        """
        spread = np.zeros(len(self.views), np.float32)
        several = np.flatnonzero(self.views > 1)
        x, y, z, length = self.sums.take(several, axis=0)[:, :4].astype(np.float64).T
        cosine = np.sqrt(x * x + y * y + z * z) / length
        spread[several] = np.degrees(np.arccos(np.minimum(cosine, 1)))
        return spread


def seen_triangles(
    meshes: Sequence[Mesh], projectors: Projectors, scene: RayScene, progress: Progress
) -> list[NDArray[np.bool_]]:
    """For each mesh, (T,) whether any view sees the triangle's centre."""
    faces = _all_faces(meshes, scene)
    seen = np.zeros(faces.positions.shape[1], bool)
    for batch in projectors.batches():
        progress(0.0, "laying out the UVs")
        for projector in batch:
            seen[projector.sample_points(faces)[0]] = True
            del projector
    return np.split(seen, np.cumsum([len(mesh.triangles) for mesh in meshes])[:-1])


def masks_hide_all(meshes: Sequence[Mesh], projectors: Projectors) -> bool:
    """Whether some camera sees a triangle's centre, ignoring the masks."""
    faces = _all_faces(meshes, projectors.scene)
    return any(len(projector.facing_points(faces)[0]) for batch in projectors.batches() for projector in batch)


def _all_faces(meshes: Sequence[Mesh], scene: RayScene) -> SurfacePoints:
    """The centres of all triangles, with the triangles' own normals."""
    middles = np.concatenate([mesh.world_vertices[mesh.triangles].mean(axis=1) for mesh in meshes]) - scene.middle
    outwards = np.concatenate([mesh.outwards for mesh in meshes]).T.copy()
    return SurfacePoints(middles.T.astype(np.float32, order="C"), outwards, outwards)
