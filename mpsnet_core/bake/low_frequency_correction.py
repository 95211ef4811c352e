"""Low-frequency correction (levelling): a view's low frequencies come from the mesh, its detail from the photo.

The errors of an estimate are smooth: a tilt, too flat here and too steep there, different in every view. A mesh from
photogrammetry has correct low frequencies, and no detail. Each normal is turned by the rotation that carries the
estimate, smoothed around it, onto the mesh's normals, smoothed in the same way.

Both are smoothed over a grid of cells in space, not in the image. The scale is a length on the object, the same in each
view, and surfaces that are neighbours in the image alone do not mix.

A mesh may also lack shapes that the photo shows. How far the two are apart is the sum of both errors, and the
estimate's confidence says how large its own should be. Where they are further apart, the mesh is wrong: the correction
can be limited to the share of it that the estimate's error explains (`agreed`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.resampling import chosen_pixels, gaussian, push_pull, reduced_shape, upsampled
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import normalised, rotated, rotation_between
from mpsnet_core.defaults import LEVEL_SCALE, MAX_LEVEL_SCALE, MIN_LEVEL_SCALE
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene, mesh_hits

# Rays are cast for at most this many pixels on the image's longer side: the result is smooth.
TRACED_PIXELS = 1024
# Grid cells per standard deviation of the smoothing.
CELLS = 2.0
# Regularises the rotation about the mean normal towards 0: only a curved surface determines it.
HOLD = 0.1
# The part of an estimate's expected squared error that is of low frequency. Distance, in scales, over which it and the
# difference from the mesh are averaged.
SMOOTH_PART, AROUND = 0.5, 2.0


@dataclass(frozen=True)
class LowFrequencyCorrection:
    """Rotations that match the low frequencies of a view's normals to the mesh's."""

    rotations: F32
    """(h, w, 3) float32. Rotation vectors (axis times angle in radians) in camera space, at a reduced resolution,
    extrapolated smoothly where the mesh is not seen."""
    known: Bools
    """(h, w) bool. Where the mesh is seen."""
    apart: float = 0.0
    """Root mean square angle in degrees between the low frequencies of the view and of the mesh."""
    share: float = 1.0
    """Mean share of the difference that is corrected."""

    @property
    def mean_angle(self) -> float:
        """Mean angle in degrees by which the normals are turned where the mesh is seen; 0 if it is not seen."""
        angles = np.linalg.norm(self.rotations[self.known], axis=1)
        return float(np.degrees(angles.mean())) if len(angles) else 0.0


@takes_files
def correct_low_frequencies(
    normals: NormalMap,
    camera: Camera,
    mesh: Mesh,
    scene: RayScene | None = None,
    *,
    scale: float = LEVEL_SCALE,
    agreed: bool = False,
) -> NormalMap:
    """Replace the low frequencies of the normals by those of the mesh.

    Parameters
    ----------
    normals : NormalMap
        Estimated normals, in camera space.
    camera : Camera
        The photo's camera.
    mesh : Mesh
        The surface, in the camera's world space.
    scene : RayScene, optional
        The mesh for ray casting, if it exists already.
    scale : float
        Standard deviation of the smoothing, as a fraction of the diagonal of the mesh's bounding box, 0.01 to 1. Relief
        smaller than about twice this is kept from the photo; larger shapes are those of the mesh.
    agreed : bool
        Take from the mesh only what the normals' expected error explains of the difference: nothing of normals with a
        confidence of 1, and little of a mesh that lacks the photo's shapes.

    Returns
    -------
    NormalMap
        The corrected normals. Where the mesh is not seen, they are turned like those nearby.

    Raises
    ------
    SettingsError
        If the scale is out of range.
    GeometryError
        If the sizes of normals and camera differ.

    Notes
    -----
    At each point the rotation vector r brings the estimates n onto the mesh's normals m by least squares with Gaussian
    weights w: it minimises ``sum w |r x n - t x n|²``, where t is the rotation vector from n to m, perpendicular to n.
    The normal equations are ``(sum w (1 - n nᵀ)) r = sum w t``: Wahba's problem (1965), linearised.

    With `agreed`, r is multiplied by ``e² / (e² + r²)``: the mean of r² around the point, and of half the squared
    expected error. That shrinks r towards the estimate, as James and Stein's estimator does (1961).
    """
    correction = find_low_frequency_correction(normals, camera, mesh, scene, scale, agreed)
    return apply_low_frequency_correction(normals, correction)


def find_low_frequency_correction(
    normals: NormalMap, camera: Camera, mesh: Mesh, scene: RayScene | None, scale: float, agreed: bool
) -> LowFrequencyCorrection:
    """The rotations that :func:`correct_low_frequencies` applies. The parameters are the same."""
    if not MIN_LEVEL_SCALE <= scale <= MAX_LEVEL_SCALE:
        raise SettingsError(
            f"a --level of {scale:g} is out of range; choose {MIN_LEVEL_SCALE:g} to {MAX_LEVEL_SCALE:g}"
        )
    height, width = normals.mask.shape
    if (camera.width, camera.height) != (width, height):
        raise GeometryError(f"the camera is {camera.width} x {camera.height} but its normals are {width} x {height}")
    scene = scene or RayScene.of(mesh)
    rows, columns = chosen_pixels(*reduced_shape(height, width, TRACED_PIXELS), height, width)
    known = normals.mask[np.ix_(rows, columns)]
    row, column = np.nonzero(known)
    seen = mesh_hits(mesh, camera, scene, np.stack([columns[column], rows[row]], axis=1) + 0.5)
    own = seen.in_camera(seen.at(mesh.corner_normals))
    front = seen.from_front
    row, column = row[seen.hit[front]], column[seen.hit[front]]
    known = np.zeros_like(known)
    known[row, column] = True
    rotations, apart, share = np.zeros((*known.shape, 3), np.float32), 0.0, 1.0
    if len(row):
        place = rows[row], columns[column]
        points, sigma = seen.points[front].astype(np.float32), scale * scene.size
        turned = _smoothed_rotations(points, normals.vectors[place], own[front], sigma)
        squared = (turned * turned).sum(axis=1)
        apart = float(np.degrees(np.sqrt(squared.mean())))
        if agreed:
            expected = SMOOTH_PART * (np.pi / 2 * (1 - normals.confidence[place].astype(np.float32))) ** 2
            expected, squared = _smoothed(points, np.stack([expected, squared]), AROUND * sigma, _means).T
            shares = expected / np.maximum(expected + squared, 1e-12)
            turned *= shares[:, None]
            share = float(shares.mean())
        rotations[row, column] = turned
    # Some rays miss between triangles, and a mask may reach a little beyond the mesh.
    return LowFrequencyCorrection(push_pull(rotations, known), known, apart, share)


def apply_low_frequency_correction(normals: NormalMap, correction: LowFrequencyCorrection) -> NormalMap:
    """Rotate the normals by the correction of their view."""
    vectors = np.zeros_like(normals.vectors)

    def rotate(rows: slice) -> None:
        inside = np.flatnonzero(normals.mask[rows])
        if len(inside):
            own, rotations = normals.vectors[rows], upsampled(correction.rotations, normals.mask.shape, rows)
            own, rotations = (one.reshape(-1, 3).take(inside, axis=0) for one in (own, rotations))
            vectors[rows].reshape(-1, 3)[inside] = rotated(own, rotations)

    on_all_cores(rotate, bands(len(vectors)))
    return replace(normals, vectors=vectors, in_place=True)


def _smoothed_rotations(points: F32, estimate: F32, own: F32, sigma: float) -> F32:
    """(N, 3) rotation vectors that best carry the estimate onto the mesh's own normals in each point's neighbourhood.

    sigma: standard deviation of the Gaussian weights, in world units.
    """
    x, y, z = estimate.T
    layers = [*rotation_between(estimate, own).T, *own.T, 1 - x * x, -x * y, -x * z, 1 - y * y, -y * z, 1 - z * z]
    return _smoothed(points, np.stack(layers), sigma, _rotation)


def _smoothed(points: F32, layers: F32, sigma: float, solve: Callable[[F32], F32]) -> F32:
    """(N, C) what `solve` makes of layers (K, N) around each point.

    sigma: standard deviation of the Gaussian weights, in world units. solve: takes the weighted sums (K + 1, M), of the
    weights as well, and returns (M, C).
    """
    cell = sigma / CELLS
    low = points.min(axis=0)
    place = (points - low) / cell + 1  # a border of one cell, for points below the first cell's centre
    shape = tuple((np.floor(place.max(axis=0)) + 2).astype(int))
    number = np.ravel_multi_index(tuple(np.round(place).astype(np.int64).T), shape)
    count = int(np.prod(shape))
    every = [*layers, np.ones(len(points))]
    grid = np.stack([np.bincount(number, layer, count).astype(np.float32) for layer in every])
    # Binning to the nearest cell (variance 1/12) and trilinear interpolation (1/6) already smooth a little.
    spread = CELLS**2 - 1 / 12 - 1 / 6
    grid = gaussian(grid.reshape(-1, *shape), spread**0.5, (1, 2, 3)).reshape(len(grid), -1)
    # Solve only in the cells that some point interpolates from.
    corner = np.floor(place).astype(np.int64)
    step = place - corner
    first = np.ravel_multi_index(tuple(corner.T), shape)
    needed = np.zeros(count, bool)
    for offset in np.ndindex(2, 2, 2):
        needed[first + np.ravel_multi_index(offset, shape)] = True
    cells = np.flatnonzero(needed)
    found = solve(grid[:, cells])
    solved = np.zeros((count, found.shape[1]), np.float32)
    solved[cells] = found
    interpolated = np.zeros((len(points), found.shape[1]), np.float32)
    for offset in np.ndindex(2, 2, 2):
        along = np.where(offset, step, 1 - step)
        # np.prod is slow along so short an axis.
        share = along[:, 0] * along[:, 1] * along[:, 2]
        interpolated += share[:, None] * solved[first + np.ravel_multi_index(offset, shape)]
    return interpolated


def _means(sums: F32) -> F32:
    """(N, K) means. sums: (K + 1, N), the last of the weights."""
    means: F32 = (sums[:-1] / np.maximum(sums[-1], np.float32(1e-12))).T
    return means


def _rotation(sums: F32) -> F32:
    """(N, 3) rotation vectors that solve the normal equations. sums: (13, N), of :func:`_smoothed_rotations`."""
    sums = sums.astype(np.float64) / np.maximum(sums[-1], 1e-12)
    middle = normalised(sums[3:6].T)
    upper = sums[[6, 7, 8, 7, 9, 10, 8, 10, 11]].T.reshape(-1, 3, 3)
    matrix = upper + HOLD * middle[:, :, None] * middle[:, None, :] + 1e-6 * np.eye(3)
    return np.linalg.solve(matrix, sums[:3].T[..., None])[..., 0].astype(np.float32)
