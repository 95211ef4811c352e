"""Projection of one view onto the surface: its samples at given points, and their weights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.sizes import SAME_SIZE, check_same_size, size
from mpsnet_core.arrays.unit_vectors import transformed
from mpsnet_core.arrays.upsample import upsampled
from mpsnet_core.bake.feather import feathered
from mpsnet_core.bake.texel_surface import SurfacePoints
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.visibility import Visibility

# Surfaces turned further from the camera than this (cosine) show too few pixels to be trusted.
MIN_FACING = 0.1
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
    colours: NDArray[np.float32] | None = None
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

    def sample_points(self, points: SurfacePoints) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
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

    def facing_points(
        self, surface: SurfacePoints
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
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

    def _facing(self, points: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """(N,) the cosine between normals and viewing directions at points, each (3, N)."""
        if self.camera.projection == "orthographic":
            facing: NDArray[np.float32] = transformed(self.turn[2:], normals)[0]
            return facing
        towards = self.eye[:, None] - points
        facing = np.einsum("in,in->n", normals, towards)
        facing /= np.sqrt(np.einsum("in,in->n", towards, towards))
        return facing

    def _interpolate(self, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
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
        mean: NDArray[np.float32] = np.add(above, below, out=above)
        return mean


def _repeated(values: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """(N, count) copies of values (N,): NumPy's broadcasting is slow along so short an axis."""
    return np.repeat(values, count).reshape(-1, count)


def _unless_all(chosen: NDArray[np.bool_]) -> NDArray[np.int64] | None:
    """The indices of True elements, None if all are True."""
    return None if chosen.all() else np.flatnonzero(chosen)


def _some(which: NDArray[np.int64], *values: NDArray[Any]) -> list[NDArray[Any]]:
    """Elements of values (N,) or (3, N) at these indices."""
    return [value.take(which, axis=-1) for value in values]
