"""Feathering: a view's weight falls off towards its borders, to avoid visible seams."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rasterize import put_rows
from mpsnet_core.arrays.resampling import chosen_pixels, upsampled
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.sizes import SAME_SIZE, check_same_size, size
from mpsnet_core.arrays.types import F32, I64, Bools
from mpsnet_core.arrays.unit_vectors import transformed
from mpsnet_core.bake.texel_surface import SurfacePoints, TexelSampler
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene, Visibility
from mpsnet_core.scene.texture import Texture

# Width of the falloff, as a fraction of the mesh's size.
FEATHER = 0.03
# Factor at the border itself, not 0: a doubtful normal is better than none where no other view looks.
FAINTEST = 0.1
# Upper limit of the width, in pixels of the depth image.
WIDEST = 96


def feathered(visibility: Visibility, mask: Bools, width: float) -> F32:
    """(h, w) factors on a view's facing: FAINTEST at its borders, rising to 1 at the distance `width` from them.

    Like facing, the factor enters the weight by its fourth power: near its border, a view yields even to a glancing
    one. Borders are those of the image, of the mask (H, W), and depth discontinuities. If the camera is slightly off,
    pixels there show another part of the object, or the background.

    width: on the object, in world units. The result has the resolution of the visibility's depth image.
    """
    height, across = visibility.shape
    inside = visibility.unbroken & mask[np.ix_(*chosen_pixels(height, across, *mask.shape))]
    pixels = int(np.clip(round(width / visibility.footprint), 1, WIDEST))
    near = border_distance(inside, pixels) / np.float32(pixels)
    return np.maximum(near * near * (3 - 2 * near), np.float32(FAINTEST))


def border_distance(inside: Bools, limit: int) -> F32:
    """(h, w) distance in pixels to the nearest pixel that is not inside, at most `limit`. Beyond the image is outside.

    An exact Euclidean distance transform: columns first, then rows.
    """
    padded = np.pad(inside, limit)
    row = np.arange(len(padded))[:, None]
    above = np.maximum.accumulate(np.where(padded, -1, row), axis=0)
    below = np.minimum.accumulate(np.where(padded, len(padded), row)[::-1], axis=0)[::-1]
    vertical = np.minimum(np.minimum(row - above, below - row), limit)[limit:-limit] ** 2
    width = inside.shape[1]
    nearest = np.full(inside.shape, limit**2)
    for step in range(-limit, limit + 1):
        np.minimum(nearest, vertical[:, limit + step : limit + step + width] + step**2, out=nearest)
    return np.sqrt(nearest).astype(np.float32)


# ----------------------------------------------------------------------------------------------------------------------
# Projection of one view onto the surface: its samples at given points, and their weights.


# Surfaces turned further from the camera than this (cosine) show too few pixels to be trusted.
MIN_FACING = 0.1
# Below this cosine, rounding decides on which side of a triangle's plane the camera is.
EDGE_ON = np.float32(1e-3)
# A view's weight is the cosine between shading normal and camera to this power: frontal views win over glancing ones.
FACING_POWER = 4


@takes_files
@dataclass(frozen=True, eq=False)
class View:
    """One photo's normals and its camera.

    Raises
    ------
    GeometryError
        If their sizes differ.
    """

    camera: Camera
    """The camera's pose in the world, and its projection."""
    normals: NormalMap
    """Normals in camera space, (H, W)."""
    colours: F32 | None = None
    """(H, W, 3) float32. Linear values to bake along with the normals, such as an albedo; NaN where they are
    unknown."""

    def __post_init__(self) -> None:
        shape = self.normals.mask.shape
        if self.colours is not None:
            colours = np.asarray(self.colours, np.float32)
            if colours.shape != (*shape, 3):
                sizes = f"{size(colours.shape)} but the normal map is {size(shape)}"
                raise GeometryError(f"the colours are {sizes}; {SAME_SIZE}")
            object.__setattr__(self, "colours", colours)
        check_same_size("the camera", (self.camera.height, self.camera.width), "its normal map", shape)


class Projector:
    """One view, prepared to be sampled at points of the surface.

    feather: distance from the view's borders at which it has its full weight, as a fraction of the mesh's size; 0 for
    sharp borders.
    """

    def __init__(self, view: View, scene: RayScene, feather: float) -> None:
        self.camera = camera = view.camera
        self.expected_error = view.normals.expected_error
        self.visibility = Visibility(camera, scene)
        away = camera.rotation.T @ (scene.middle - camera.world_from_camera[:3, 3])
        # The scene's centre in camera space, and the rotation from world to camera axes.
        self.middle, self.turn = away.astype(np.float32), camera.rotation.T.astype(np.float32)
        self.eye = (camera.world_from_camera[:3, 3] - scene.middle).astype(np.float32)
        # Crop to the part of the image in which the mesh may be seen.
        self.rows, self.columns = rows, columns = scene.extent(camera)
        shape = rows.stop - rows.start, columns.stop - columns.start
        normals, colours = view.normals, view.colours
        share = None
        if feather > 0:
            share = feathered(self.visibility, normals.mask, feather * scene.size)
        # (h + 2, w + 2, 4): world normals times their weight, and the weight. With colours (h + 2, w + 2, 8): the
        # colours times their weight, and that weight, follow. A border of zeros makes a special case at the image's
        # edge unnecessary.
        self.samples = np.zeros((shape[0] + 2, shape[1] + 2, 4 if colours is None else 8), np.float32)

        def fill(band: slice) -> None:
            within = slice(rows.start + band.start, rows.start + band.stop)
            out = self.samples[1 + band.start : 1 + band.stop, 1:-1]
            # Not 0 where the confidence is 0: a doubtful normal is better than none.
            weight = np.maximum(normals.confidence[within, columns], np.float32(0.01), dtype=np.float32)
            weight *= normals.mask[within, columns]
            if share is not None:
                weight *= upsampled(share, normals.mask.shape, within)[:, columns] ** FACING_POWER
            world = normals.vectors[within, columns].astype(np.float32, copy=False) @ self.turn
            for axis in range(3):
                np.multiply(world[..., axis], weight, out=out[..., axis])
            out[..., 3] = weight
            if colours is not None:
                known = np.all(np.isfinite(colours[within, columns]), axis=-1)
                for axis in range(3):
                    out[..., 4 + axis] = np.where(known, colours[within, columns, axis], 0) * weight
                out[..., 7] = known * weight

        on_all_cores(fill, bands(shape[0]))

    def faces(self, surface: TexelSampler) -> Bools:
        """(T,) whether the camera is in front of each triangle, or too close to its plane to tell."""
        return self._facing(surface.position[:3], surface.outwards) > -EDGE_ON

    def sample_points(self, points: SurfacePoints) -> tuple[I64, F32]:
        """(M,) indices of the N surface points that the view sees, and its samples there.

        A sample, (M, 4), is the weighted normal in world space and the weight; of views with colours, (M, 8), the
        weighted colour and its weight follow. Positions are relative to the scene's centre. The triangles decide what
        is seen; the weight changes smoothly, with the shading normals.
        """
        seen, facing, x, y = self.facing_points(points)
        sampled = self._interpolate(x, y)
        kept = _unless_all(sampled[:, 3] > 0)
        if kept is not None:
            seen, sampled = seen.take(kept), sampled.take(kept, axis=0)
        facing = np.maximum(facing.take(seen), np.float32(MIN_FACING))
        for _ in range(2):  # squared twice: FACING_POWER
            facing *= facing
        sampled *= _repeated(facing, sampled.shape[1])
        return seen, sampled

    def facing_points(self, surface: SurfacePoints) -> tuple[I64, F32, F32, F32]:
        """(M,) indices of the points that the camera sees, regardless of the view's mask.

        Also (N,) the cosine between shading normal and viewing direction of all points, and (M,) x and (M,) y of the
        pixels.
        """
        flat = self.camera.projection == "orthographic"
        facing, outwards = (self._facing(surface.positions, one) for one in (surface.normals, surface.outwards))
        seen = np.flatnonzero((outwards > 0) & (np.maximum(facing, outwards) > MIN_FACING))
        points = surface.positions.take(seen, axis=1)
        x, y, z = transformed(self.turn, points)
        x += self.middle[0]
        y += self.middle[1]
        depth = -z
        x *= np.float32(self.camera.focal[0])
        y *= np.float32(-self.camera.focal[1])
        if not flat:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                x /= depth - self.middle[2]
                y /= depth - self.middle[2]
        x += np.float32(self.camera.centre[0])
        y += np.float32(self.camera.centre[1])
        inside = (x > -0.5) & (x < self.camera.width + 0.5) & (y > -0.5) & (y < self.camera.height + 0.5)
        if not flat:
            inside &= depth > self.middle[2]
        kept = _unless_all(inside)
        if kept is not None:
            seen, points, x, y, depth = _some(kept, seen, points, x, y, depth)
        kept = _unless_all(self.visibility.seen(points, x, y, depth))
        if kept is not None:
            seen, x, y = _some(kept, seen, x, y)
        return seen, facing, x, y

    def _facing(self, points: F32, normals: F32) -> F32:
        """(N,) the cosine between normals and viewing directions at points, each (3, N)."""
        if self.camera.projection == "orthographic":
            return transformed(self.turn[2:], normals)[0]
        towards = self.eye[:, None] - points
        facing = np.einsum("in,in->n", normals, towards)
        facing /= np.sqrt(np.einsum("in,in->n", towards, towards))
        return facing

    def _interpolate(self, x: F32, y: F32) -> F32:
        """Bilinear samples between pixel centres. Pixels outside the mask have no weight."""
        height, stride, count = self.samples.shape
        # The border adds one pixel; pixel centres are at 0.5.
        x, y = x - np.float32(self.columns.start - 0.5), y - np.float32(self.rows.start - 0.5)
        column, row = x.astype(np.int32), y.astype(np.int32)
        np.clip(column, 0, stride - 2, out=column)
        np.clip(row, 0, height - 2, out=row)
        x -= column
        y -= row
        across, down = _repeated(x, count), _repeated(y, count)
        flat, corner = self.samples.reshape(-1, count), row.astype(np.int64) * stride + column
        above, right_texel = flat.take(corner, axis=0), flat.take(corner + 1, axis=0)
        right_texel -= above
        right_texel *= across
        above += right_texel
        corner += stride
        below, right_texel = flat.take(corner, axis=0), flat.take(corner + 1, axis=0)
        right_texel -= below
        right_texel *= across
        below += right_texel
        below -= above
        below *= down
        return np.add(above, below, out=above)


def _repeated(values: F32, count: int) -> F32:
    """(N, count) copies of values (N,): NumPy's broadcasting is slow along so short an axis."""
    return np.repeat(values, count).reshape(-1, count)


def _unless_all(chosen: Bools) -> I64 | None:
    """The indices of True elements, None if all are True."""
    return None if chosen.all() else np.flatnonzero(chosen)


def _some(which: I64, *values: NDArray[Any]) -> list[NDArray[Any]]:
    """Elements of values (N,) or (3, N) at these indices."""
    return [value.take(which, axis=-1) for value in values]


# ----------------------------------------------------------------------------------------------------------------------
# Accumulation of the views' samples at points of the surface, with as many views in memory as fit.


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
                raise GeometryError("some views have colours and others none; give all of them colours, or none")
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

    sums: F32
    """(N, 4). Weighted normals in world space, and the lengths of these vectors; with colours (N, 8), weighted colours
    and their weights follow."""
    views: NDArray[np.uint16]
    """(N,). Number of views that see the texel."""

    @classmethod
    def none(cls, count: int, values: int) -> "ViewAccumulator":
        """Zero sums for `count` texels. values: number of values per sample."""
        return cls(np.zeros((count, values), np.float32), np.zeros(count, np.uint16))

    @classmethod
    def kept(cls, texture: Texture, texels: I64) -> "ViewAccumulator":
        """The sums that :meth:`keep` stored in a texture, at the texels of these flat indices."""
        assert texture.spread is not None and texture.views is not None
        sums = [texture.vectors.reshape(-1, 3).take(texels, axis=0), texture.spread.reshape(-1, 1).take(texels, axis=0)]
        if texture.colours is not None:
            sums.append(texture.colours.reshape(-1, 4).take(texels, axis=0))
        return cls(np.concatenate(sums, axis=1), texture.views.ravel().take(texels))

    def keep(self, texture: Texture, texels: I64) -> None:
        """Store the sums in the texture that will be made from them: there is not enough memory for both."""
        assert texture.spread is not None and texture.views is not None
        texture.vectors.reshape(-1, 3)[texels] = self.sums[:, :3]
        texture.spread.ravel()[texels] = self.sums[:, 3]
        texture.views.ravel()[texels] = self.views
        if texture.colours is not None:
            texture.colours.reshape(-1, 4)[texels] = self.sums[:, 4:]

    def add(self, seen: I64, samples: F32) -> None:
        """Add one view's samples from :meth:`Projector.sample_points`."""
        x, y, z = samples[:, 0], samples[:, 1], samples[:, 2]
        samples[:, 3] = np.sqrt(x * x + y * y + z * z)
        if self.views.any():
            samples += self.sums.take(seen, axis=0)
        put_rows(self.sums, seen, samples)
        self.views[seen] = self.views.take(seen) + np.uint16(1)

    def spread(self) -> F32:
        """(N,) degrees: the angle whose cosine is the weighted mean cosine between the views' normals and their mean.

        That mean cosine is the weighted sum's length over the sum of the lengths.
        """
        spread = np.zeros(len(self.views), np.float32)
        several = np.flatnonzero(self.views > 1)
        x, y, z, length = self.sums.take(several, axis=0)[:, :4].astype(np.float64).T
        cosine = np.sqrt(x * x + y * y + z * z) / length
        spread[several] = np.degrees(np.arccos(np.minimum(cosine, 1)))
        return spread


def seen_triangles(meshes: Sequence[Mesh], projectors: Projectors, scene: RayScene, progress: Progress) -> list[Bools]:
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
