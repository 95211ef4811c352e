"""Levelling: a view's low frequencies taken from the mesh, its detail from the photo.

An estimate errs smoothly: it is tilted, or too flat here and too steep there, and differently so in every view. A mesh
from photogrammetry is right there, and has no detail. So each pixel's normal is turned by the rotation that carries the
estimate, smoothed around it, onto the mesh's normals, smoothed in the same way.

Both are smoothed along the surface, not along the image: over a grid of cells in space, so that the scale is a length
on the object, the same in each view, and nothing reaches over from what only stands behind it in the image.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.gaussian import gaussian
from mpsnet_core.arrays.push_pull import push_pull
from mpsnet_core.arrays.rotations import rotated, rotation_between
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape, upsampled
from mpsnet_core.defaults import LEVEL_SCALE, MAX_LEVEL_SCALE, MIN_LEVEL_SCALE
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.mesh_seen import mesh_seen
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene

# The mesh is traced at no more than this many pixels on the image's longer side: what is wanted of it is smooth.
TRACED_PIXELS = 1024
# Cells to a standard deviation of the smoothing.
CELLS = 2.0
# How firmly the rotation about the mean normal is held at 0, which only a curved surface determines.
HOLD = 0.1


@dataclass(frozen=True)
class Levelling:
    """What turns a view's normals.

    turns: (h, w, 3) float32 rotation vectors (axis times angle in radians) in camera space, for an image of fewer
    pixels, going on smoothly where the mesh is not seen. known: (h, w) bool, where it is.
    """

    turns: NDArray[np.float32]
    known: NDArray[np.bool_]

    @property
    def mean_angle(self) -> float:
        """How far the normals are turned, in degrees, mean over where the mesh is seen; 0 where it is not."""
        angles = np.linalg.norm(self.turns[self.known], axis=1)
        return float(np.degrees(angles.mean())) if len(angles) else 0.0


def parse_scale(text: str) -> float:
    """The levelling's scale that is meant by on, off or a number; 0 for none. Raises SettingsError if none is."""
    if text in ("on", "off"):
        return LEVEL_SCALE if text == "on" else 0.0
    try:
        scale = float(text)
    except ValueError:
        scale = 0.0
    if not MIN_LEVEL_SCALE <= scale <= MAX_LEVEL_SCALE:
        raise SettingsError(
            f"--level {text} is not known; give on, off, or a scale from {MIN_LEVEL_SCALE:g} to {MAX_LEVEL_SCALE:g}"
        )
    return scale


def correct_low_frequencies(
    normals: NormalMap, camera: Camera, mesh: Mesh, scene: RayScene | None = None, *, scale: float = LEVEL_SCALE
) -> NormalMap:
    """The normals with the low frequencies of the mesh's own; where the mesh is not seen, they turn as nearby.

    Parameters
    ----------
    normals : NormalMap
        Estimated, in camera space.
    camera : Camera
        What the pixels see.
    mesh : Mesh
        The surface, in the camera's world.
    scene : RayScene, optional
        The mesh's, where it exists already.
    scale : float
        Standard deviation of the smoothing, as a share of the diagonal of the mesh's bounding box, 0.01 to 1. Relief
        smaller than about twice this is kept as the photo shows it; larger forms are those of the mesh.

    Returns
    -------
    NormalMap

    Raises
    ------
    SettingsError
        If the scale is out of range.
    GeometryError
        If the sizes of normals and camera differ.

    Notes
    -----
    Around each place the rotation vector r is found that brings the estimates n onto the mesh's normals m by least
    squares with Gaussian weights w: ``sum w |r x n - t|²``, t the rotation vector from n to m, which is perpendicular
    to n. That is ``(sum w (1 - n nᵀ)) r = sum w t``: Wahba's problem (1965), linearised.
    """
    return turned(normals, levelling(normals, camera, mesh, scene, scale=scale))


def levelling(
    normals: NormalMap, camera: Camera, mesh: Mesh, scene: RayScene | None = None, *, scale: float = LEVEL_SCALE
) -> Levelling:
    """The rotations that :func:`correct_low_frequencies` turns the normals by, with its parameters."""
    if not MIN_LEVEL_SCALE <= scale <= MAX_LEVEL_SCALE:
        raise SettingsError(
            f"a levelling scale of {scale:g} cannot be used; choose {MIN_LEVEL_SCALE:g} to {MAX_LEVEL_SCALE:g}"
        )
    height, width = normals.mask.shape
    if (camera.width, camera.height) != (width, height):
        raise GeometryError(f"the camera is {camera.width} x {camera.height} but its normals are {width} x {height}")
    scene = scene or RayScene.of(mesh)
    rows, columns = chosen_pixels(*reduced_shape(height, width, TRACED_PIXELS), height, width)
    known = normals.mask[np.ix_(rows, columns)]
    row, column = np.nonzero(known)
    seen = mesh_seen(mesh, camera, scene, np.stack([columns[column], rows[row]], axis=1) + 0.5)
    own = seen.in_camera(seen.at(mesh.corner_normals))
    front = seen.from_front(own)
    row, column = row[seen.hit[front]], column[seen.hit[front]]
    known = np.zeros_like(known)
    known[row, column] = True
    turns = np.zeros((*known.shape, 3), np.float32)
    if len(row):
        points, estimate = seen.points[front].astype(np.float32), normals.vectors[rows[row], columns[column]]
        turns[row, column] = _smoothed_turns(points, estimate, own[front], scale * scene.size)
    # Rays slip between triangles here and there, and a mask may reach a little beyond the mesh.
    return Levelling(push_pull(turns, known), known)


def turned(normals: NormalMap, by: Levelling) -> NormalMap:
    """The normals turned by a levelling of their own view."""
    vectors = np.zeros_like(normals.vectors)

    def turn(rows: slice) -> None:
        inside = np.flatnonzero(normals.mask[rows])
        if len(inside):
            own, turns = normals.vectors[rows], upsampled(by.turns, normals.mask.shape, rows)
            own, turns = (one.reshape(-1, 3).take(inside, axis=0) for one in (own, turns))
            vectors[rows].reshape(-1, 3)[inside] = rotated(own, turns)

    on_all_cores(turn, bands(len(vectors)))
    return replace(normals, vectors=vectors, in_place=True)


def _smoothed_turns(
    points: NDArray[np.float32], estimate: NDArray[np.float32], own: NDArray[np.float32], sigma: float
) -> NDArray[np.float32]:
    """(N, 3) rotation vectors that carry the estimate to the mesh's own normals around each point."""
    cell = sigma / CELLS
    low = points.min(axis=0)
    place = (points - low) / cell + 1  # a border of one cell, for what lies between it and the first
    shape = tuple((np.floor(place.max(axis=0)) + 2).astype(int))
    number = np.ravel_multi_index(tuple(np.round(place).astype(np.int64).T), shape)
    x, y, z = estimate.T
    layers = [*rotation_between(estimate, own).T, *own.T, 1 - x * x, -x * y, -x * z, 1 - y * y, -y * z, 1 - z * z]
    count = int(np.prod(shape))
    grid = np.stack([np.bincount(number, layer, count).astype(np.float32) for layer in [*layers, np.ones(len(x))]])
    # Values are laid into the nearest cell and read from between cells, which smooths them by a little already.
    spread = CELLS**2 - 1 / 12 - 1 / 6
    grid = gaussian(grid.reshape(-1, *shape), spread**0.5, (1, 2, 3)).reshape(len(grid), -1)
    # Only cells that a point lies between are needed.
    corner = np.floor(place).astype(np.int64)
    step = place - corner
    first = np.ravel_multi_index(tuple(corner.T), shape)
    needed = np.zeros(count, bool)
    for offset in np.ndindex(2, 2, 2):
        needed[first + np.ravel_multi_index(offset, shape)] = True
    cells = np.flatnonzero(needed)
    solved = np.zeros((count, 3), np.float32)
    solved[cells] = _rotation(grid[:, cells])
    turns = np.zeros_like(points)
    for offset in np.ndindex(2, 2, 2):
        along = np.where(offset, step, 1 - step)
        # NumPy's own product is slow along so short an axis.
        share = along[:, 0] * along[:, 1] * along[:, 2]
        turns += share[:, None] * solved[first + np.ravel_multi_index(offset, shape)]
    return turns


def _rotation(sums: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 3) the rotation vectors that solve the sums (13, N) of :func:`_smoothed_turns`' layers."""
    sums = sums.astype(np.float64) / np.maximum(sums[-1], 1e-12)
    middle = normalised(sums[3:6].T)
    upper = sums[[6, 7, 8, 7, 9, 10, 8, 10, 11]].T.reshape(-1, 3, 3)
    matrix = upper + HOLD * middle[:, :, None] * middle[:, None, :] + 1e-6 * np.eye(3)
    return np.linalg.solve(matrix, sums[:3].T[..., None])[..., 0].astype(np.float32)
