"""Eight photos of a bumpy sphere whose every normal is known from calculus, with what goes wrong on a real table.

The mesh to bake onto is a smooth sphere of few triangles, as photogrammetry gives it: the right shape, no detail.
"""

from dataclasses import dataclass

import numpy as np
from surface_shapes import camera_looking, first_on_sphere, sphere_mesh, towards_camera
from synthetic import degrees_between

from mpsnet_core import Camera, NormalMap, View, bake_normals, correct_low_frequencies, published_rig
from mpsnet_core.bake.projection import FEATHER

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def bumpy_normals(points: np.ndarray, waves: float = 30.0, height: float = 0.35) -> np.ndarray:
    """(N, 3) unit normals at points (N, 3) of the unit sphere whose radius is 1 + h(p), to first order in h.

    They are p less h's gradient along the sphere; h is a sum of products of sines, `waves` radians a unit.
    """
    x, y, z = (waves * points).T
    gradient = height * np.stack(
        [np.cos(x + 1) * np.sin(y), np.sin(x + 1) * np.cos(y) + np.cos(y) * np.sin(z), np.cos(z) * np.sin(y)], axis=1
    )
    gradient -= (gradient * points).sum(axis=1, keepdims=True) * points
    return unit(points - gradient)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def turn(axis: np.ndarray, degrees: float) -> np.ndarray:
    """(3, 3) rotation about an axis, by the matrix exponential's closed form."""
    x, y, z = unit(np.asarray(axis, float))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@dataclass(frozen=True)
class Shot:
    """One photo. camera: as it is believed to be. image: linear, under the published rig. points: (H, W, 3) of the
    sphere, in the world. normals: (H, W, 3) true ones in the space of the camera as it truly was."""

    camera: Camera
    image: np.ndarray
    mask: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def shot(
    corner: tuple[float, float, float],
    size: int,
    rng: np.random.Generator,
    *,
    noise: float,
    off: float,
    reach: float = 1.1,
    shadows: bool = True,
) -> Shot:
    """The sphere seen from a corner of the cube. off: degrees that the believed camera is turned about the sphere's
    middle and, as many hundredths of a radius for each degree, moved. reach: half the picture's width, in radii.
    shadows: whether a light behind the surface gives nothing; else it takes light away, which no lamp does, but from
    such a photo the normals follow everywhere."""
    camera = camera_looking(corner, "perspective", size=size, distance=5.0, reach=reach)
    row, column = np.mgrid[:size, :size].reshape(2, -1) + 0.5
    middle = camera.world_from_camera[:3, 3]
    along = np.stack([(column - size / 2) / camera.focal[0], (size / 2 - row) / camera.focal[0], -np.ones_like(row)], 1)
    on_image = middle + along @ camera.rotation.T
    points = first_on_sphere(on_image, towards_camera(camera, on_image), np.eye(4))
    mask = np.isfinite(points).all(axis=1)
    points = np.nan_to_num(points)
    points[~mask] = (0, 0, 1)
    normals = bumpy_normals(points) @ camera.rotation
    image = 0.7 * np.maximum(normals @ published_rig().directions.T, 0 if shadows else -1)
    image = np.maximum(image + noise * rng.normal(size=image.shape), 0 if shadows else -1)
    pose = camera.world_from_camera.copy()
    wrong = turn(rng.normal(size=3), off)
    pose[:3, :3] = wrong @ pose[:3, :3]
    pose[:3, 3] = wrong @ pose[:3, 3] + 0.01 * off * unit(rng.normal(size=3))
    believed = Camera("perspective", size, size, camera.focal, None, pose)
    grid = (size, size)
    return Shot(
        believed, image.reshape(*grid, 3), mask.reshape(grid), points.reshape(*grid, 3), normals.reshape(*grid, 3)
    )


def smoothly_wrong(normals: np.ndarray, points: np.ndarray, rng: np.random.Generator, degrees: float) -> np.ndarray:
    """Unit normals (H, W, 3) turned by a smooth field, about `degrees` of it, as networks err: each view otherwise."""
    waves, phases = rng.normal(size=(3, 3)), rng.uniform(0, 2 * np.pi, 3)
    field = np.sin(points @ waves.T * 1.2 + phases)
    angle = np.radians(degrees) * field / np.sqrt(1.5)
    # First-order turns are enough to be wrong by.
    wrong = normals + np.cross(angle, normals)
    return wrong / np.maximum(np.linalg.norm(wrong, axis=-1, keepdims=True), 1e-9)


@dataclass(frozen=True)
class SphereTexels:
    """The texels of :func:`sphere_mesh` whose triangles are told by its layout alone: row, column (N,).

    points: (N, 3) of the unit sphere straight above the mesh there. truth: (N, 3) its bumpy normals.
    """

    size: int
    row: np.ndarray
    column: np.ndarray
    points: np.ndarray
    truth: np.ndarray


def sphere_texels(size: int, columns: int = 48, rows: int = 24) -> SphereTexels:
    """UVs are a grid of cells, each cut from lower left to upper right; half of those at the poles are empty."""
    row, column = np.mgrid[:size, :size].reshape(2, -1)
    u = ((column + 0.5) / size - 0.01) / 0.98 * columns
    v = ((size - row - 0.5) / size - 0.01) / 0.98 * rows
    inside = (u > 0) & (u < columns) & (v > 0) & (v < rows)
    row, column, u, v = row[inside], column[inside], u[inside], v[inside]
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    s, t = u - i, v - j
    lower = s > t  # the triangle of the cell's corners (0, 0), (1, 0), (1, 1)

    def corner(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        azimuth, height = 2 * np.pi * i / columns - np.pi / 2, np.pi * (j / rows - 0.5)
        return np.stack([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)], axis=1)

    weights = np.where(lower[:, None], np.stack([1 - s, s - t, t], 1), np.stack([1 - t, s, t - s], 1))
    third = np.where(lower[:, None], corner(i + 1, j), corner(i, j + 1))
    places = [corner(i, j), np.where(lower[:, None], third, corner(i + 1, j + 1))]
    places += [np.where(lower[:, None], corner(i + 1, j + 1), third)]
    points = unit(sum(weight[:, None] * place for weight, place in zip(weights.T, places, strict=True)))
    there = np.where(lower, j > 0, j < rows - 1)
    row, column, points = row[there], column[there], points[there]
    return SphereTexels(size, row, column, points, bumpy_normals(points))


def borders(texels: SphereTexels, cameras: list[Camera], views: np.ndarray) -> np.ndarray:
    """(S, S) a number for each texel that changes where the leading view does, or the number of views.

    0 where none sees the texel, -1 off the mesh. On a sphere the leading view is the one that looks most squarely,
    known without the bake.
    """
    facing = np.stack([(towards_camera(camera, texels.points) * texels.points).sum(axis=1) for camera in cameras])
    label = np.full((texels.size, texels.size), -1)
    count = views[texels.row, texels.column].astype(int)
    label[texels.row, texels.column] = np.where(count > 0, facing.argmax(axis=0) * 64 + count, 0)
    return label


def near_ends(texels: SphereTexels, label: np.ndarray, width: float = 0.15) -> np.ndarray:
    """(S, S) where a texel that no view sees is within about `width` radii: in the same or the next cell of a grid."""
    cell = tuple(np.floor((texels.points + 1) / width).astype(int).T + 1)
    unseen = np.zeros((int(2 / width) + 4,) * 3, bool)
    unseen[tuple(axis[label[texels.row, texels.column] == 0] for axis in cell)] = True
    for axis in range(3):
        unseen = unseen | np.roll(unseen, 1, axis) | np.roll(unseen, -1, axis)
    near = np.zeros(label.shape, bool)
    near[texels.row, texels.column] = unseen[cell]
    return near


REACH = 1 / 256  # the part of the texture that a side's mean is taken over
PIECE = 8  # pieces of border are so many times as long and wide at most
MIN_COUNT = 2  # and at least this long


def jumps(error: np.ndarray, label: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Degrees by which the error (S, S, 3) jumps at each piece of border between views, of border where all views end
    or nearly do, and at pieces without border, far from those ends.

    On each side of a texel's edge the mean errors of the square next to it and of the one beyond are carried on
    linearly to the edge; the jump is the difference there, the mean along the piece. A smooth change is none, and noise
    and misplaced relief, which are everywhere, mean out.
    """
    reach = round(REACH * len(label))
    sums = np.zeros((len(label) + 1, len(label) + 1, 4))
    sums[1:, 1:, :3] = error.cumsum(0).cumsum(1)
    sums[1:, 1:, 3] = (label >= 0).cumsum(0).cumsum(1)
    at_borders, at_ends, elsewhere = [], [], []
    for axis in (0, 1):
        low, high = (label[:-1], label[1:]) if axis == 0 else (label[:, :-1], label[:, 1:])
        ending = (near[:-1] | near[1:]) if axis == 0 else (near[:, :-1] | near[:, 1:])
        border = (low >= 0) & (high >= 0) & (low != high)
        plain = (low > 0) & (low == high)
        for found, into in ((border & ~ending, at_borders), (border & ending, at_ends), (plain & ~ending, elsewhere)):
            row, column = np.nonzero(found)
            margin = 2 * reach + 2
            within = (np.minimum(row, column) > margin) & (np.maximum(row, column) < len(label) - margin)
            row, column = row[within], column[within]
            patches = [_patch(sums, row, column, axis, step, reach) for step in (-2, -1, 0, 1)]
            whole = np.all([count == reach**2 for _, count in patches], axis=0)
            before, here, there, beyond = (mean for mean, _ in patches)
            jump = (1.5 * there - 0.5 * beyond) - (1.5 * here - 0.5 * before)
            sides = low[row, column] * 1000 + high[row, column]
            piece = (row // (PIECE * reach) * 1000 + column // (PIECE * reach)) * 10**6 + sides
            _, number, count = np.unique(piece[whole], return_inverse=True, return_counts=True)
            total = np.stack([np.bincount(number, jump[whole][:, k]) for k in range(3)], axis=1)
            into.append(np.degrees(np.linalg.norm(total / count[:, None], axis=1))[count >= MIN_COUNT * reach])
    return np.concatenate(at_borders), np.concatenate(at_ends), np.concatenate(elsewhere)


def _patch(
    sums: np.ndarray, row: np.ndarray, column: np.ndarray, axis: int, step: int, reach: int
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) the mean over a square that lies `step` squares from an edge, and how many of its texels are seen."""
    across, along = (row, column) if axis == 0 else (column, row)
    across, along = across + 1 + step * reach, along - reach // 2
    top, left = (across, along) if axis == 0 else (along, across)
    bottom, right = top + reach, left + reach
    total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
    return total[:, :3] / reach**2, total[:, 3]


@dataclass(frozen=True)
class Outcome:
    """Angles in degrees of a baked texture: its mean error where it is seen, and its steps (:func:`jumps`)."""

    seen: float
    error: float
    spread: float
    at_borders: np.ndarray
    at_ends: np.ndarray
    elsewhere: np.ndarray


def wrong_views(pixels: int) -> list[View]:
    """Eight views from photos with noise of 0.01, estimates that err smoothly by 7° and cameras that are wrong by 0.2°
    and 0.002 radii. The first four show the whole sphere; the others end within it, where the first go on.

    The estimate is Lambert's, without attached shadows: where a light does not reach it would err by itself, with steps
    that no border has a part in.
    """
    rng = np.random.default_rng(5)
    views = []
    for number, corner in enumerate(sorted(CORNERS, key=np.prod)):
        reach = 0.7 if number > 3 else 1.1
        seen = shot(corner, pixels, rng, noise=0.01, off=0.2, reach=reach, shadows=False)
        # estimate_normals does not take brightness below 0.
        estimate = unit(seen.image @ np.linalg.inv(published_rig().directions).T)
        normals = NormalMap(smoothly_wrong(estimate, seen.points, rng, 7.0), seen.mask, np.ones(seen.mask.shape))
        views.append(View(seen.camera, normals))
    return views


def all_levelled(views: list[View]) -> list[View]:
    mesh = sphere_mesh(48, 24)
    return [View(view.camera, correct_low_frequencies(view.normals, view.camera, mesh)) for view in views]


def outcome(views: list[View], texels: SphereTexels, feather: float = FEATHER) -> Outcome:
    """What becomes of the views in one texture."""
    texture = bake_normals(sphere_mesh(48, 24), views, size=texels.size, space="object", margin=0, feather=feather)
    place = (texels.row, texels.column)
    error = np.zeros_like(texture.vectors)
    error[place] = texture.vectors[place] - texels.truth
    label = borders(texels, [view.camera for view in views], texture.views)
    angles = degrees_between(texture.vectors[place], texels.truth)[texture.seen[place]]
    spread = float(texture.spread[texture.views > 1].mean())
    steps = jumps(error, label, near_ends(texels, label))
    return Outcome(texture.seen_fraction, float(angles.mean()), spread, *steps)
