"""The camera from pairs of a pixel in the photo and the corresponding point on the mesh."""

import json
import os
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.types import Bools, Floats
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.estimate.alignment.pose import PARAMETERS, Poses, flow, spread_rotations
from mpsnet_core.io.files import check_small, existing_file
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera

MIN_PAIRS = 4
STARTS = 64
PROMISING = 8  # of the starts
FIRST_STEPS, STEPS = 10, 40
# Prior of an unknown focal length, in longer sides of the image: a 50 mm lens, with a standard deviation of a factor of
# two. It matters only if the pairs do not determine the focal length.
USUAL_FOCAL, FOCAL_SPREAD = 50 / 36, 0.7
PIXEL_ERROR = 2.0  # of a careful click, in pixels of an image of 1,024 pixels
# A pair is an outlier if its error is this multiple of the others' without it, and this large in pixels of 1,024.
WRONG_RATIO, WRONG_PIXELS = 6.0, 12.0


@dataclass(frozen=True)
class PointFit:
    """A camera fitted to pairs."""

    camera: Camera
    """The camera: perspective, with the image's size."""
    residuals: Floats
    """(N,). Reprojection error of each pair, in pixels."""
    left_out: tuple[int, ...]
    """Numbers of the pairs that contradict the others and were not used, from 0."""


def camera_from_points(
    pixels: Floats,
    points: Floats,
    width: int,
    height: int,
    lens: Camera | None = None,
    *,
    usual_focal: float = USUAL_FOCAL,
) -> PointFit:
    """The perspective camera that sees `points` at `pixels`.

    Parameters
    ----------
    pixels
        (N, 2) from the top left corner of the image, x to the right and y down.
    points
        (N, 3) the corresponding points in world space.
    width, height
        Of the image.
    lens
        A camera of this size with the known focal length and principal point. Its pose is ignored.
    usual_focal
        The most likely focal length without a `lens`, in longer sides of the image, as :data:`USUAL_FOCAL`.

    Raises
    ------
    GeometryError
        If there are fewer than four pairs, they are collinear, or no camera fits them.

    Notes
    -----
    Gauss-Newton with Levenberg damping on the reprojection error, from many rotations at once, each with the
    translation of a scaled orthographic camera. Leaving out each pair in turn detects one that contradicts all others.
    """
    pixels, points = np.asarray(pixels, np.float64), np.asarray(points, np.float64)
    if len(points) < MIN_PAIRS:
        raise GeometryError(f"{len(points)} pairs do not determine a camera; give {MIN_PAIRS} or more, ideally 6 to 12")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not spread[1] > 1e-3 * spread[0]:
        raise GeometryError("the points on the mesh lie on one line; choose some that do not")
    least = MIN_PAIRS + 1 if lens else MIN_PAIRS + 2
    fits = [np.ones(len(points), bool)]
    if len(points) >= least:
        fits += [np.arange(len(points)) != k for k in range(len(points))]
    unit = max(width, height) / 1024
    fitted, residuals, errors = _fits(pixels, points, np.array(fits), width, height, lens, usual_focal)
    used = 0
    if len(fits) > 1:
        best = 1 + int(np.argmin(errors[1:]))
        off, others = residuals[best, best - 1], errors[best]
        if off > max(WRONG_RATIO * others, WRONG_PIXELS * unit) and errors[0] > 2 * others:
            used = best
    if not np.isfinite(errors[used]):
        raise GeometryError("no camera sees these points at these pixels; check the pairs")
    camera = fitted.camera(width, height, used)
    return PointFit(camera, residuals[used], () if used == 0 else (used - 1,))


def reprojection_errors(camera: Camera, pixels: Floats, points: Floats) -> Floats:
    """(N,). Reprojection errors in pixels of `points` (N, 3) at `pixels` (N, 2)."""
    poses = Poses.of(camera)
    return np.asarray(np.linalg.norm(poses.projected(poses.in_camera(points))[0] - pixels, axis=1))


def _fits(
    pixels: Floats, points: Floats, used: Bools, width: int, height: int, lens: Camera | None, usual_focal: float
) -> tuple[Poses, Floats, Floats]:
    """Best poses for S subsets (S, N) of the pairs, residuals (S, N), and their root mean square (S,) in the subset."""
    longer = max(width, height)
    middle, size = points.mean(axis=0), np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    local = (points - middle) / size
    focals = lens.focal[:1] if lens else np.array([0.8, usual_focal, 4.0]) * float(longer)
    starts = _starts(pixels, local, used, lens.centre if lens else np.array([width / 2, height / 2]), focals)
    choice = np.repeat(np.arange(len(used)), STARTS * len(focals))
    weight = used[choice].astype(np.float64)
    prior = PIXEL_ERROR * longer / 1024 / FOCAL_SPREAD
    known = None if lens else (float(np.log(longer * usual_focal)), prior)
    # A few steps identify the promising starts.
    begun, cost = _solved(starts, pixels, local, weight, known, FIRST_STEPS)
    kept = np.argsort(cost.reshape(len(used), -1), axis=1)[:, :PROMISING]
    kept = (kept + np.arange(len(used))[:, None] * STARTS * len(focals)).ravel()
    weight = weight[kept]
    poses, _ = _solved(begun.subset(kept), pixels, local, weight, known, STEPS)
    off = np.linalg.norm(poses.projected(poses.in_camera(local)) - pixels, axis=2)
    behind = (poses.in_camera(local)[..., 2] > -1e-6).any(axis=1)
    count = weight.sum(axis=1)
    error = np.where(behind, np.inf, np.sqrt((weight * off**2).sum(axis=1) / count))
    error = np.where(np.isfinite(error), error, np.inf)
    best = error.reshape(len(used), -1).argmin(axis=1) + np.arange(len(used)) * PROMISING
    found = poses.subset(best)
    # From the points' normalised frame back to world space.
    translation = found.translation * size - np.einsum("kij,j->ki", found.rotation, middle)
    world = Poses(found.rotation, translation, found.focal, found.centre)
    return world, off[best], error[best]


def _starts(pixels: Floats, points: Floats, used: Bools, centre: Floats, focals: Floats) -> Poses:
    """Initial poses by scaled orthography, for each subset of pairs, each focal length and each of many rotations."""
    turns = spread_rotations(STARTS)
    rotation = np.tile(turns, (len(used) * len(focals), 1, 1))
    focal = np.tile(np.repeat(focals, STARTS), len(used))
    weight = np.repeat(used, STARTS * len(focals), axis=0)[..., None].astype(np.float64)
    count = weight.sum(axis=1)
    seen = (points @ rotation.transpose(0, 2, 1))[..., :2] * (1, -1)
    middle, target = (weight * seen).sum(axis=1) / count, (weight * pixels).sum(axis=1) / count
    own, wanted = weight * (seen - middle[:, None]), weight * (pixels - target[:, None])
    scale = np.sqrt((wanted**2).sum(axis=(1, 2)) / np.maximum((own**2).sum(axis=(1, 2)), 1e-12))
    distance = np.maximum(focal / np.maximum(scale, 1e-12), 1.5)
    offset = (target - centre) / scale[:, None] - middle
    return Poses(rotation, np.stack([offset[:, 0], -offset[:, 1], -distance], axis=1), focal, centre)


def _solved(
    poses: Poses, pixels: Floats, points: Floats, weight: Floats, prior: tuple[float, float] | None, steps: int
) -> tuple[Poses, Floats]:
    """Poses (K) that project points to pixels, and their sums of squares (K,), by damped Gauss-Newton.

    weight: (K, N). prior: mean of the log focal length, and its weight in pixels; None if the focal length is known.
    """
    free = PARAMETERS if prior else PARAMETERS - 1
    damping = np.full(len(poses.focal), 1e-3)
    residual, cost = _residual(poses, pixels, points, weight, prior)
    for _ in range(steps):
        jacobian = flow(poses.in_camera(points), poses.focal[:, None]) * np.sqrt(weight)[..., None, None]
        jacobian = jacobian.reshape(len(damping), -1, PARAMETERS)[..., :free]
        if prior:
            row = np.zeros((len(damping), 1, free))
            row[:, 0, 6] = prior[1]
            jacobian = np.concatenate([jacobian, row], axis=1)
        normal = jacobian.transpose(0, 2, 1) @ jacobian
        diagonal = np.einsum("kii->ki", normal) + 1e-9
        damped = normal + (damping[:, None] * diagonal)[..., None] * np.eye(free)
        step = np.zeros((len(damping), PARAMETERS))
        step[:, :free] = -np.linalg.solve(damped, jacobian.transpose(0, 2, 1) @ residual[..., None])[..., 0]
        step[:, :3] = _shortened(step[:, :3], 0.5)
        step[:, 6] = np.clip(step[:, 6], -0.5, 0.5)
        tried = poses.moved(step)
        new_residual, new_cost = _residual(tried, pixels, points, weight, prior)
        better = new_cost < cost
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-9, 1e6)
        poses = Poses(
            np.where(better[:, None, None], tried.rotation, poses.rotation),
            np.where(better[:, None], tried.translation, poses.translation),
            np.where(better, tried.focal, poses.focal),
            poses.centre,
        )
        residual = np.where(better[:, None], new_residual, residual)
        cost = np.where(better, new_cost, cost)
    return poses, cost


def _shortened(vectors: Floats, longest: float) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors * np.minimum(1, longest / np.maximum(length, 1e-12))


def _residual(
    poses: Poses, pixels: Floats, points: Floats, weight: Floats, prior: tuple[float, float] | None
) -> tuple[Floats, Floats]:
    """Residuals (K, 2 N), or one more for the prior, and sums of squares (K,), infinite for points behind it."""
    seen = poses.in_camera(points)
    residual = (poses.projected(seen) - pixels) * np.sqrt(weight)[..., None]
    residual = residual.reshape(len(residual), -1)
    if prior:
        middle, strength = prior
        residual = np.concatenate([residual, strength * (np.log(poses.focal) - middle)[:, None]], axis=1)
    cost = (residual**2).sum(axis=1)
    behind = np.any((seen[..., 2] > -1e-6) & (weight > 0), axis=1)
    return np.where(behind[:, None], 0.0, residual), np.where(behind, np.inf, cost)


# --- files of point pairs: pixels of a photo and the corresponding points on a mesh -----------------------------------


MAX_PAIRS = 1000
FARTHEST = 1e9
_EXAMPLE = '{"pairs": [{"pixel": [x, y], "point": [X, Y, Z]}, ...]}'


def read_pairs(path: AnyPath) -> tuple[Floats, Floats]:
    """Read a JSON file ``{"pairs": [{"pixel": [x, y], "point": [X, Y, Z]}, ...]}``.

    Returns
    -------
    pixels
        (N, 2) from the photo's top left corner, x to the right and y down.
    points
        (N, 3) in the mesh file's own axes.

    Raises
    ------
    FileError
        If there is no such file.
    FormatError
        If it is not such a file.
    """
    path = existing_file(path, "file of pairs")
    check_small(path, "no file of pairs")
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError):
        raise FormatError(f"{path} is not valid JSON; write it as {_EXAMPLE}") from None
    pairs = data.get("pairs") if isinstance(data, dict) else None
    if not isinstance(pairs, list) or not 1 <= len(pairs) <= MAX_PAIRS:
        raise FormatError(f"{path} holds no list of 1 to {MAX_PAIRS} pairs; write it as {_EXAMPLE}")
    found = []
    for number, pair in enumerate(pairs, 1):
        if not isinstance(pair, dict) or set(pair) != {"pixel", "point"}:
            raise FormatError(f'{path}: pair {number} is not made of "pixel" and "point"; write it as {_EXAMPLE}')
        found.append([*_numbers(path, number, pair, "pixel", 2), *_numbers(path, number, pair, "point", 3)])
    values = np.array(found)
    return values[:, :2], values[:, 2:]


def _numbers(path: os.PathLike[str], number: int, pair: dict[str, object], key: str, count: int) -> list[float]:
    values = pair[key]
    right = isinstance(values, list) and len(values) == count
    if not right or not all(type(value) in (int, float) and abs(value) <= FARTHEST for value in values):  # type: ignore[attr-defined]
        raise FormatError(f'{path}: the "{key}" of pair {number} is not {count} numbers up to {FARTHEST:g}; correct it')
    return [float(value) for value in values]  # type: ignore[attr-defined]
