"""Refine a rough camera: fit a mesh's outline and normals to a photo's."""

from dataclasses import dataclass, field

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box, eroded
from mpsnet_core.arrays.resampling import block_means, gaussian
from mpsnet_core.arrays.statistics import deviation
from mpsnet_core.arrays.types import Bools, Floats, Indices
from mpsnet_core.arrays.unit_vectors import cross_matrix
from mpsnet_core.estimate.alignment.pose import PARAMETERS, MeshFaces, Poses, SeenFaces, flow
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene

Pixels = Floats

# The object's longer side in pixels on each scale, and the maximum number of steps there.
SCALES = ((64, 10), (128, 6), (256, 10), (512, 8))
MEASURED = 256  # pixels of the object's longer side, to measure a fit
# Around the object, as a share of its longer side; less on finer scales than the measured one, where the fit is near.
MARGIN, FINE_MARGIN = 0.25, 0.1
OUTLINE_POINTS = 1500
NORMAL_PIXELS = 5_000
# Standard deviations of outlines, in pixels of a scale; of normals, in radians, whose smooth errors count as this many
# independent pixels; and of their detail, whose errors are independent at this share of the pixels.
OUTLINE_SIGMA = 1.0
NORMAL_SIGMA, INDEPENDENT = 0.3, 200
DETAIL_SIGMA, DETAIL_SHARE, MOST_DETAILS = 0.15, 0.1, 2000.0
SMOOTH, WIDE = 1.0, 6.0  # Gaussians in pixels of a scale: to smooth both normals, and to subtract from them for detail
LONGEST_STEP = 0.1  # in radians, shares of the object's distance, and log focal length
SETTLED = 0.05  # stop if a step moves the object's image by fewer pixels of the scale
MOTION_POINTS = 500
FIXED_FOCAL_SCALE = 128  # the focal length is fixed on scales up to this one
FOCAL_SPREAD = 0.2  # prior standard deviation of the log focal length about its start


@dataclass(frozen=True)
class Fit:
    """A camera, and how well the mesh through it fits the photo."""

    camera: Camera
    """The camera: perspective, with the image's size."""
    outline: float
    """Median distance of the mesh's outline from the mask's, in the photo's pixels."""
    degrees: float
    """Median angle between the mesh's normals and the photo's, where mesh and mask overlap."""
    overlap: float
    """Intersection over union of mesh and mask."""

    @property
    def cost(self) -> float:
        """Cost to compare fits of one photo; smaller is better."""
        return (1 - self.overlap) + self.degrees / 60


@dataclass(frozen=True)
class _Scale:
    """The photo on one scale, cropped to the object and a margin."""

    factor: int
    """Size of its pixels, in the photo's pixels."""
    origin: tuple[int, int]
    """(row, column) of its first pixel in the photo."""
    normals: Pixels
    """(h, w, 3). The photo's normals."""
    detail: Pixels
    """(h, w, 3). The normals minus their Gaussian mean."""
    inside: Bools
    """(h, w). The mask."""
    eroded_mask: Bools
    """(h, w). The mask, eroded."""
    outline: Floats
    """(N, 2). Points of the mask's outline."""
    across: Floats = field(repr=False)
    """(N, 2). Outward normals of the outline at these points."""


@dataclass(frozen=True)
class PhotoPyramid:
    """A photo's normals on all scales, each made when it is first needed."""

    estimate: NormalMap
    """The photo's normals and mask."""
    _scales: dict[int, _Scale] = field(default_factory=dict, init=False, repr=False)

    def at(self, longest: int) -> _Scale:
        """The scale on which the object's longer side has about this many pixels."""
        if longest not in self._scales:
            self._scales[longest] = _scale(self.estimate, longest)
        return self._scales[longest]


def refine_camera(
    photo: PhotoPyramid,
    faces: MeshFaces,
    start: Camera,
    *,
    fix_focal: bool = False,
    scales: tuple[tuple[int, int], ...] = SCALES,
    progress: Progress = silent,
) -> Fit:
    """The camera near `start` through which the mesh fits the photo best.

    Parameters
    ----------
    photo
        The normals of the photo, and its mask.
    faces
        The mesh.
    start
        At most about 10 degrees and a tenth of the object's size from the solution.
    fix_focal
        Whether to keep the focal length.
    scales
        Pixels of the object's longer side and maximum number of steps, coarse to fine.
    progress
        Called with the share done, 0 to 1, and a message.

    Notes
    -----
    Gauss-Newton, coarse to fine, with three kinds of robust residuals: distances between both outlines (point to line,
    both ways); normals; and their detail, which is normals minus their Gaussian mean. Detail localises the surface even
    if the estimated normals have smooth errors. Derivatives are those of the image of a rigid surface.
    """
    height, width = photo.estimate.mask.shape
    local = _local(Poses.of(start), faces.scene)
    first = float(np.log(local.focal[0]))
    # The first scale with the photo's own pixels is the finest. A step's time grows with its pixels.
    finest = next((number for number, (longest, _) in enumerate(scales) if photo.at(longest).factor == 1), len(scales))
    scales, done = scales[: finest + 1], 0
    work = sum(photo.at(longest).inside.size * steps for longest, steps in scales)
    for longest, steps in scales:
        scale = photo.at(longest)
        # Rotate and shift a rough start first: a wrong focal length could compensate for its errors.
        fixed = fix_focal or longest <= FIXED_FOCAL_SCALE
        before = np.zeros((1, PARAMETERS))
        for number in range(steps):
            progress((done + number * scale.inside.size) / work, "refining")
            image = _image(scale, local, faces)
            step = _step(scale, image, local, first, fixed)
            if (step * before).sum() < 0:  # it went too far, and would go to and fro
                step *= 0.5
            before, local = step, local.moved(step)
            if _motion(image, local.focal[0], step) < SETTLED * scale.factor:
                break
        done += scale.inside.size * steps
    camera = _world(local, faces.scene).camera(width, height)
    return measure_fit(photo, faces, camera)


def measure_fit(photo: PhotoPyramid, faces: MeshFaces, camera: Camera, longest: int = MEASURED) -> Fit:
    """Measure how well the mesh, seen by a camera, fits the photo. longest: pixels of the object's longer side."""
    local = _local(Poses.of(camera), faces.scene)
    scale = photo.at(longest)
    image = _image(scale, local, faces)
    union, both = scale.inside | image.mask, scale.inside & image.mask
    overlap = int(both.sum()) / max(1, int(union.sum()))
    cosine = (_smooth(image.normals, image.mask, SMOOTH) * scale.normals).sum(axis=-1)[both]
    degrees = float(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1)))) if both.any() else 180.0
    mine, _ = _outline(image.mask.astype(np.float32))
    if len(mine) and len(scale.outline):
        distance = float(np.median(np.linalg.norm(mine - scale.outline[_nearest(mine, scale.outline)], axis=1)))
    else:
        distance = np.inf
    return Fit(camera, distance * scale.factor, degrees, float(overlap))


def _local(poses: Poses, scene: RayScene) -> Poses:
    """Normalise the poses by the object's size and centre: all parameters then have a similar scale."""
    translation = (poses.translation + poses.rotation @ scene.middle) / scene.size
    return Poses(poses.rotation, translation, poses.focal, poses.centre)


def _world(local: Poses, scene: RayScene) -> Poses:
    translation = local.translation * scene.size - local.rotation @ scene.middle
    return Poses(local.rotation, translation, local.focal, local.centre)


def _scale(estimate: NormalMap, longest: int) -> _Scale:
    rows, columns = bounding_box(estimate.mask)
    side = max(rows.stop - rows.start, columns.stop - columns.start)
    factor = max(1, round(side / longest))
    border = round((FINE_MARGIN if longest > MEASURED else MARGIN) * side)
    top, left = (max(0, part.start - border) // factor * factor for part in (rows, columns))
    window = slice(top, rows.stop + border), slice(left, columns.stop + border)
    mask, normals = estimate.mask[window], estimate.vectors[window]
    shares = block_means(mask[..., None].astype(np.float32), factor)[..., 0]
    means = block_means(normals, factor)
    inside = shares >= 0.5
    smooth = _smooth(means, inside, SMOOTH)
    outline, across = _outline(shares)
    return _Scale(factor, (top, left), smooth, _detail(smooth, inside), inside, eroded(inside, 2), outline, across)


def _image(scale: _Scale, local: Poses, faces: MeshFaces) -> SeenFaces:
    """What the camera sees of the mesh on a scale."""
    height, width = scale.inside.shape
    top, left = scale.origin
    x = left + (np.arange(width) + 0.5) * scale.factor
    y = top + (np.arange(height) + 0.5) * scale.factor
    camera = _world(local, faces.scene).camera(width * scale.factor + left, height * scale.factor + top)
    return faces.seen(camera, x, y)


def _motion(image: SeenFaces, focal: float, step: Floats) -> float:
    """Mean distance in the photo's pixels by which a step moves the mesh's image."""
    points = image.points[image.mask]
    points = points[:: len(points) // MOTION_POINTS + 1]
    moved = np.linalg.norm(flow(points, np.full(len(points), focal)) @ step[0], axis=1)
    return float(moved.mean()) if len(points) else 0.0


def _step(scale: _Scale, image: SeenFaces, local: Poses, first: float, fix_focal: bool) -> Floats:
    """(1, 7) the next Gauss-Newton step."""
    focal = local.focal[0]
    normal, gradient = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    for residual, jacobian in (*_outline_terms(scale, image, focal), *_normal_terms(scale, image, focal)):
        normal += jacobian.T @ jacobian
        gradient += jacobian.T @ residual
    weight = FOCAL_SPREAD**-2
    normal[6, 6] += weight
    gradient[6] += weight * (np.log(focal) - first)
    free = PARAMETERS - 1 if fix_focal else PARAMETERS
    step = np.zeros((1, PARAMETERS))
    damped = normal + 1e-6 * np.diag(np.diag(normal)) + 1e-6 * np.eye(PARAMETERS)
    step[0, :free] = -np.linalg.solve(damped[:free, :free], gradient[:free])
    # Shorten all components alike: rotation and translation may nearly cancel in the image.
    lengths = np.linalg.norm(step[0, :3]), np.linalg.norm(step[0, 3:6]) / abs(local.translation[0, 2]), abs(step[0, 6])
    step *= min(1.0, LONGEST_STEP / max(*lengths, 1e-12))
    return step


def _outline_terms(scale: _Scale, image: SeenFaces, focal: float) -> list[tuple[Floats, Floats]]:
    """Weighted residuals of both outlines, and their derivatives."""
    mine, across = _outline(image.mask.astype(np.float32))
    if not len(mine) or not len(scale.outline):
        return []
    # An outline point takes its surface position from the adjacent pixel inside.
    height, width = image.mask.shape
    step_in = np.clip(mine - 0.75 * across, 0, (width - 1e-6, height - 1e-6)).astype(int)
    points = image.points[step_in[:, 1], step_in[:, 0]]
    on_mesh = image.mask[step_in[:, 1], step_in[:, 0]]
    mine, across, points = mine[on_mesh], across[on_mesh], points[on_mesh]
    if not len(mine):
        return []
    moving = flow(points, np.full(len(points), focal)) / scale.factor
    near, back, found = _nearest(mine, scale.outline), _nearest(scale.outline, mine), []
    for offset, along, by, own in (
        (mine - scale.outline[near], scale.across[near], moving, across),
        (mine[back] - scale.outline, scale.across, moving[back], across[back]),
    ):
        residual = (offset * along).sum(axis=1) / OUTLINE_SIGMA
        jacobian = np.einsum("nc,ncp->np", along, by) / OUTLINE_SIGMA
        # Outlines with different normals do not correspond.
        weight = _robust(residual) * np.maximum((along * own).sum(axis=1), 0) / 2
        found.append((residual * np.sqrt(weight), jacobian * np.sqrt(weight)[:, None]))
    return found


def _normal_terms(scale: _Scale, image: SeenFaces, focal: float) -> list[tuple[Floats, Floats]]:
    """Weighted residuals of normals and of their detail, and their derivatives."""
    both = scale.eroded_mask & eroded(image.mask, 2)
    rows, columns = np.nonzero(both)
    if not len(rows):
        return []
    details = min(DETAIL_SHARE * len(rows), MOST_DETAILS)
    if len(rows) > NORMAL_PIXELS:
        kept = np.linspace(0, len(rows) - 1, NORMAL_PIXELS).astype(int)
        rows, columns = rows[kept], columns[kept]
    smooth = _smooth(image.normals, image.mask, SMOOTH)
    moving = flow(image.points[rows, columns], np.full(len(rows), focal)) / scale.factor
    found = []
    detail = _detail(smooth, image.mask)
    for own, other, sigma, count in (
        (smooth, scale.normals, NORMAL_SIGMA, INDEPENDENT),
        (detail, scale.detail, DETAIL_SIGMA, details),
    ):
        here = own[rows, columns]
        residual = (here - other[rows, columns]) / sigma
        jacobian = np.zeros((len(rows), 3, PARAMETERS))
        jacobian[..., :3] = -cross_matrix(here)
        gradient = np.stack([np.gradient(own, axis=axis)[rows, columns] for axis in (1, 0)], axis=-1)
        jacobian -= gradient @ moving
        jacobian /= sigma
        length = np.linalg.norm(residual, axis=1)
        weight = np.sqrt(_robust(length) * count / len(rows))
        found.append(((residual * weight[:, None]).ravel(), (jacobian * weight[:, None, None]).reshape(-1, PARAMETERS)))
    return found


def _robust(residual: Floats) -> Floats:
    """Cauchy weights, with the scale of the residuals' deviation, at least 1."""
    spread = deviation(residual, 1.0)
    return 1 / (1 + (residual / (2 * spread)) ** 2)


def _detail(smooth: Pixels, inside: Bools) -> Pixels:
    return np.where(inside[..., None], smooth - _smooth(smooth, inside, WIDE), 0)


def _smooth(values: Pixels, inside: Bools, sigma: float) -> Pixels:
    """Gaussian mean of values (h, w, C) over the pixels inside; zero outside."""
    weight = gaussian(inside[..., None].astype(values.dtype), sigma, (0, 1))
    means = gaussian(np.where(inside[..., None], values, 0), sigma, (0, 1)) / np.maximum(weight, 1e-6)
    return np.where(inside[..., None], means, 0)


def _outline(shares: Pixels) -> tuple[Floats, Floats]:
    """Points (N, 2) (x, y) in pixels where an object's coverage (h, w) crosses 1/2, and outward unit normals (N, 2)."""
    padded = np.pad(shares, 1)
    gradients = np.stack([np.gradient(gaussian(padded, 1.5, (0, 1)), axis=axis) for axis in (1, 0)], axis=-1)
    points, normals = [], []
    for axis in (0, 1):
        low, high = (padded[:-1], padded[1:]) if axis == 0 else (padded[:, :-1], padded[:, 1:])
        crossing = (low >= 0.5) != (high >= 0.5)
        row, column = np.nonzero(crossing)
        share = (0.5 - low[crossing]) / (high[crossing] - low[crossing])
        place = np.stack([column + 0.5, row + 0.5], axis=1) + share[:, None] * ((0, 1) if axis == 0 else (1, 0))
        points.append(place - 1)
        normals.append(-gradients[row, column])
    point, normal = np.concatenate(points), np.concatenate(normals)
    length = np.linalg.norm(normal, axis=1)
    # Where the image border cuts the object off, there is no outline.
    height, width = shares.shape
    kept = (length > 1e-9) & (point > 0.51).all(axis=1) & (point < (width - 0.51, height - 0.51)).all(axis=1)
    point, normal = point[kept], normal[kept] / length[kept, None]
    if len(point) > OUTLINE_POINTS:
        some = np.linspace(0, len(point) - 1, OUTLINE_POINTS).astype(int)
        point, normal = point[some], normal[some]
    return point, normal


def _nearest(points: Floats, others: Floats) -> Indices:
    """(N,) index of the nearest of `others` (M, 2) to each of `points` (N, 2)."""
    squared = (others**2).sum(axis=1) - 2 * points @ others.T
    return squared.argmin(axis=1)
