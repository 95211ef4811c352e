"""Depth gradients from normals: for every pixel, the change to its neighbours."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box, dilated, labelled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.height_map import HeightMap, check_size, pixels_per_unit
from mpsnet_core.relief.integration.poisson import Links, relax_locally, restrict, right_side, solve_poisson
from mpsnet_core.scene.camera import Camera, pixel_camera
from mpsnet_core.scene.normal_map import NormalMap

# Limit of steepness (cosine of the angle to the line of sight; 87°). It applies to steeper normals and to those that
# face away from the camera, which cannot be seen. It is close to 90° for the rims of round objects, and does little
# harm: equations are weighted by the square of this cosine.
MIN_FACING = 0.05


@dataclass(frozen=True)
class Gradients:
    """Equations for every pixel: `facing * change = right`, and `= down`, with the unknown's change to the next pixel.

    The unknown is depth along the camera's axis, in pixels, for an orthographic camera, and the logarithm of depth,
    times the focal length in pixels, for a perspective one. The factor `facing` on both sides reduces the weight of
    steep pixels in least squares, because their gradients are uncertain.
    """

    facing: F32
    """(H, W) float32. The factor on the change, at least MIN_FACING inside the mask, 0 outside."""
    right: F32
    """(H, W) float32. `facing` times the change to the next pixel on the right, 0 outside the mask."""
    down: F32
    """(H, W) float32. `facing` times the change to the next pixel below, 0 outside the mask."""
    mask: Bools
    """(H, W) bool. Where the surface is."""


def gradients(normals: NormalMap, camera: Camera, box: tuple[slice, slice] | None = None) -> Gradients:
    """The changes of depth that normals (in camera space) require.

    box: the rows and columns of the result; None for all.

    A normal n is perpendicular to both tangents of the surface, the changes of its point p along columns and rows.
    Orthographic, with z up to a constant: n_z dz = -n_x dx. Perspective, with p = d (X, Y, -1) and u = log d:
    (n_z - n_x X - n_y Y) du = n_x dX, which is independent of the scale of d (Queau, Durou and Aujol, "Normal
    Integration: A Survey", 2018, section 2; Cao et al., "Bilateral Normal Integration", 2022, equation 6).
    """
    scale = pixels_per_unit(camera)
    height, width = normals.mask.shape
    x = ((np.arange(width) + 0.5 - camera.centre[0]) / camera.focal[0]).astype(np.float32)
    y = ((camera.centre[1] - np.arange(height) - 0.5) / camera.focal[1]).astype(np.float32)
    box = box or (slice(0, height), slice(0, width))
    vectors, mask, x, y = normals.vectors[box], normals.mask[box], x[box[1]], y[box[0], None]
    found = np.zeros((3, *mask.shape), np.float32)
    for rows in bands(len(mask)):
        n_x, n_y, n_z = np.moveaxis(vectors[rows], -1, 0)
        facing = n_z if camera.projection == "orthographic" else n_z - n_x * x - n_y * y[rows]
        inside = mask[rows]
        found[0, rows][inside] = np.maximum(facing, MIN_FACING)[inside]
        found[1, rows][inside] = (n_x * np.float32(scale / camera.focal[0]))[inside]
        found[2, rows][inside] = (n_y * np.float32(-scale / camera.focal[1]))[inside]
    return Gradients(found[0], found[1], found[2], mask)


# ----------------------------------------------------------------------------------------------------------------------
# The fast method: least squares over all pixels, a surface without breaks.


# The changes along the four links of a loop of pixels sum to 0 on a continuous surface. If the sum (curl) is this many
# pixels, there is a depth discontinuity, and the weight of the loop's links is halved; it falls off quadratically.
LOOSE = np.float32(0.03)


def fast(wanted: Gradients, progress: Progress = silent) -> F32:
    """(H, W) depth, in the unit of :class:`Gradients`, by Poisson's equation.

    The change over a link is the mean of those that its two pixels require, weighted by the square of their `facing`.
    Links around loops that do not close have less weight, which keeps inconsistencies local (weights from the curl, as
    in Agrawal, Raskar and Chellappa, "What is the range of surface reconstructions from a gradient field?", 2006).
    """
    weights, weighted_changes = equations(wanted)
    sums = right_side(weighted_changes)
    del wanted, weighted_changes  # the solver takes much memory for a large photo
    return solve_poisson(weights, sums, np.zeros_like(sums), progress=progress)


def equations(wanted: Gradients) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times the weight."""
    facing, mask = wanted.facing, wanted.mask
    square = np.square(facing)
    weights = Links(_means(square.T, mask.T).T, _means(square, mask))
    del square
    weighted_changes = Links(_means((facing * wanted.right).T, mask.T).T, _means(facing * wanted.down, mask))
    trust = np.empty((len(weights.down), weights.right.shape[1]), np.float32)
    for rows in bands(len(trust)):
        trust[rows] = _loop_weights(*(_of_loops(links, rows) for links in (weights, weighted_changes)))
    for loops, *pair in (
        (trust, weights.right, weighted_changes.right),
        (trust.T, weights.down.T, weighted_changes.down.T),
    ):
        factors = np.ones_like(pair[0])
        factors[:-1] = loops
        np.minimum(factors[1:], loops, out=factors[1:])
        for links in pair:
            links *= factors
    return weights, weighted_changes


def _means(values: F32, mask: Bools) -> F32:
    """(N - 1, M) the mean of both pixels' values (N, M) for every link along the first axis; 0 if one is outside."""
    means = values[1:] + values[:-1]
    means *= np.float32(0.5)
    means[~(mask[1:] & mask[:-1])] = 0
    return means


def _of_loops(links: Links, rows: slice) -> Links:
    """The links of some rows of loops, each of which is between two rows of pixels."""
    return Links(links.right[rows.start : rows.stop + 1], links.down[rows])


def _loop_weights(weights: Links, weighted_changes: Links) -> F32:
    """(H - 1, W - 1) factor from 0 to 1 of each loop of four links, by how far it is from closing.

    A link gets the lower one of its two loops.
    """
    right, down = _changes(weights.right, weighted_changes.right), _changes(weights.down, weighted_changes.down)
    loose = right[:-1] + down[:, 1:]
    loose -= right[1:]
    loose -= down[:, :-1]
    # A loop that the mask interrupts gives no information.
    for side in (weights.right[:-1], weights.right[1:], weights.down[:, :-1], weights.down[:, 1:]):
        loose[side == 0] = 0
    loose *= 1 / LOOSE
    loose *= loose
    loose += 1
    return np.reciprocal(loose, out=loose)


def _changes(weight: F32, weighted_change: F32) -> F32:
    return np.divide(weighted_change, weight, out=np.zeros_like(weighted_change), where=weight > 0)


# ----------------------------------------------------------------------------------------------------------------------
# The bilateral method: a surface with breaks at depth discontinuities.


# Sharpness of a pixel's choice between its two neighbours (k in the paper, with its value), for changes in pixels.
SHARPNESS = np.float32(2)
# Least weight of a neighbour: a part that is cut off all around stays where least squares put it.
MIN_WEIGHT = np.float32(1e-5)
# Residual of a pixel's equation, in pixels times `facing`, on its chosen side, at which its weight is halved. The first
# two are for the first and last pass at the coarsest level, because early cuts are seldom undone. The third is for all
# passes at finer levels, where breaks are nearly in place.
FIRST_OFF, SMALL_OFF, OFF = 8.0, 2.0, 0.5
# The search for breaks around those of a coarser level: links below this fraction of their full weight are cut, the
# true break is at most this many pixels away, and this many steps relax the pixels in between.
CUT, BESIDE, SEARCHING = np.float32(0.1), 2, 24
# In this search, the difference of the gradients of a link's two pixels, times `facing`, at which its weight is halved.
APART = np.float32(0.1)
# The coarsest level has at most this many pixels on its longer side.
SMALL = 200
# Passes at the coarsest level, where most changes happen, and at each finer one; solver iterations per pass.
FIRST_PASSES, PASSES, ITERATIONS = 24, 12, 6
# The fraction of a level's progress that its initial depth takes.
STARTED = 0.25


def bilateral(wanted: Gradients, progress: Progress = silent) -> F32:
    """(H, W) depth, in the unit of :class:`Gradients`, by Cao, Santo, Okura and Matsushita, "Bilateral Normal
    Integration", 2022.

    The surface is assumed to be continuous from each pixel to at least one of its two neighbours in its row, and in its
    column. Each pixel's equation applies to both, weighted by a sigmoid of the difference of the two squared changes:
    the smaller change gets the larger weight. Weights and depth are updated alternately.

    The paper takes up to a hundred such passes, each with a solve from scratch. Here the work goes from coarse to fine:
    a half-size level first positions large parts, the coarsest one starts from :func:`fast`, which detects loops that
    do not close, and each pass continues with a few multigrid iterations. A coarser level locates breaks only to its
    own pixels; see :func:`_searched`.

    Unlike in the paper, the weight of a pixel whose equation holds on neither side is reduced, more from pass to pass
    at the coarsest level (graduated non-convexity: Blake and Zisserman, "Visual Reconstruction", 1987). Otherwise false
    breaks across thin connections would persist, and straight ones would grow from the ends of true breaks.
    """
    before = part(progress, 0.0, STARTED, "finding depth's edges")
    if max(wanted.mask.shape) <= SMALL:
        depth, offs = fast(wanted, before), np.geomspace(FIRST_OFF, SMALL_OFF, FIRST_PASSES)
    else:
        smaller = _halved(wanted)
        depth = _searched(wanted, _doubled(bilateral(smaller, before), smaller, wanted.mask))
        offs = np.full(PASSES, OFF)
    for number, off in enumerate(offs):
        done, all_done = (STARTED + (1 - STARTED) * count / len(offs) for count in (number, number + 1))
        step = part(progress, done, all_done, "finding depth's edges")
        weights, weighted_changes = chosen_sides(wanted, depth, off)
        sums = right_side(weighted_changes)
        depth = solve_poisson(weights, sums, depth, max_iterations=ITERATIONS, progress=step)
    return depth


def _halved(wanted: Gradients) -> Gradients:
    """The equations of the half-size level: means over blocks of 2 x 2 pixels."""
    count = restrict(wanted.mask.astype(np.float32))
    mask = count > 0
    np.maximum(count, 1, out=count)
    facing, right, down = (restrict(values) / count for values in (wanted.facing, wanted.right, wanted.down))
    return Gradients(facing, right, down, mask)


def _doubled(depth: F32, smaller: Gradients, mask: Bools) -> F32:
    """Depth of all pixels of the mask, from that of their 2 x 2 blocks and the blocks' gradients."""
    doubled = np.zeros(mask.shape, np.float32)
    facing = np.maximum(smaller.facing, MIN_FACING)
    right, down = smaller.right / facing, smaller.down / facing
    for row, column in np.ndindex(2, 2):
        pixels = doubled[row::2, column::2]
        blocks = 2 * depth + (column - np.float32(0.5)) * right + (row - np.float32(0.5)) * down
        pixels[:] = blocks[: pixels.shape[0], : pixels.shape[1]]
    doubled[~mask] = 0
    return doubled


def _searched(wanted: Gradients, depth: F32) -> F32:
    """Depth in which the pixels next to each break belong to neither side, so that the break can move.

    After doubling, breaks are staircases of two pixels. A pixel on the wrong side would stay there: it is continuous
    with its neighbours on that side, and its link to the right side is cut. With every doubling the stairs would grow.
    So these pixels are relaxed between the surfaces on both sides, which are fixed, with most of the change where
    neighbours require different gradients or loops do not close. The passes that follow decide anew.
    """
    beside = dilated(_breaks(wanted, chosen_sides(wanted, depth)[0]), BESIDE - 1)
    weights, weighted_changes = equations(wanted)
    gradient_right, gradient_down = (
        np.divide(values, wanted.facing, out=np.zeros_like(values), where=wanted.mask)
        for values in (wanted.right, wanted.down)
    )
    alike = _agreement(gradient_right.T, wanted.facing.T).T, _agreement(gradient_down, wanted.facing)
    for links in (weights, weighted_changes):
        links.right[:] *= alike[0]
        links.down[:] *= alike[1]
    return relax_locally(weights, weighted_changes, depth, beside, SEARCHING)


def _breaks(wanted: Gradients, weights: Links) -> Bools:
    """(H, W) the pixels at both ends of the links that are cut."""
    mask, square = wanted.mask, np.square(wanted.facing)
    broken = np.zeros_like(mask)
    for links, one, other in (
        (weights.right, np.s_[:, :-1], np.s_[:, 1:]),
        (weights.down, np.s_[:-1, :], np.s_[1:, :]),
    ):
        cut = (links < CUT * (square[one] + square[other])) & mask[one] & mask[other]
        broken[one] |= cut
        broken[other] |= cut
    return broken


def _agreement(gradient: F32, facing: F32) -> F32:
    """(N - 1, M) agreement, from 0 to 1, of the pixels (N, M) at both ends of links along the first axis."""
    apart = (gradient[1:] - gradient[:-1]) * np.minimum(facing[1:], facing[:-1])
    return np.reciprocal(1 + np.square(apart / APART))


def chosen_sides(wanted: Gradients, depth: F32, off: float = OFF) -> tuple[Links, Links]:
    """Each link's weight, and its wanted change times the weight, given the current depth.

    off: residual of a pixel's equation, in pixels times `facing`, at which its weight is halved.
    """
    height, width = depth.shape
    weights = Links(np.zeros((height, width - 1), np.float32), np.zeros((height - 1, width), np.float32))
    weighted_changes = Links(np.zeros_like(weights.right), np.zeros_like(weights.down))
    for rows in bands(height):
        facing, right, mask = wanted.facing[rows].T, wanted.right[rows].T, wanted.mask[rows].T
        weight, weighted_change = _along(depth[rows].T, facing, right, mask, off)
        weights.right[rows], weighted_changes.right[rows] = weight.T, weighted_change.T
        # Both pixels of a link compare it with the change on their other side: one more row above and below.
        top = max(rows.start - 1, 0)
        near = slice(top, rows.stop + 2)
        weight, weighted_change = _along(depth[near], wanted.facing[near], wanted.down[near], wanted.mask[near], off)
        links = slice(rows.start, min(rows.stop, height - 1))
        weights.down[links], weighted_changes.down[links] = (
            found[rows.start - top : links.stop - top] for found in (weight, weighted_change)
        )
    return weights, weighted_changes


def _along(depth: F32, facing: F32, wanted: F32, mask: Bools, off: float) -> tuple[F32, F32]:
    """Weights and weighted changes, each (N - 1, M), of the links along the first axis of (N, M) pixels."""
    linked = mask[1:] & mask[:-1]
    change = (depth[1:] - depth[:-1]) * linked
    # By how much the squared change behind each pixel exceeds that ahead; 0 where there is no neighbour.
    steeper = np.zeros_like(depth)
    steeper[1:] = np.square(facing[1:] * change)
    steeper[:-1] -= np.square(facing[:-1] * change)
    # The sigmoid by tanh, which does not overflow.
    ahead = np.tanh(steeper * (SHARPNESS / 2)) * np.float32(0.5) + np.float32(0.5)
    first = ahead[:-1] / (1 + np.square((facing[:-1] * change - wanted[:-1]) / np.float32(off)))
    second = (1 - ahead[1:]) / (1 + np.square((facing[1:] * change - wanted[1:]) / np.float32(off)))
    counts = np.maximum(first, MIN_WEIGHT) * facing[:-1], np.maximum(second, MIN_WEIGHT) * facing[1:]
    weight = (counts[0] * facing[:-1] + counts[1] * facing[1:]) * linked
    weighted_change = (counts[0] * wanted[:-1] + counts[1] * wanted[1:]) * linked
    return weight, weighted_change


# ----------------------------------------------------------------------------------------------------------------------
# Integration of normals to heights.


Method = Literal["fast", "bilateral"]
METHODS: tuple[Method, ...] = get_args(Method)

# The image is cropped to the object at multiples of this many pixels, so that the blocks of the solver's coarse grids
# do not depend on the object's position.
GRAIN = 32
# Limit of the logarithm of depth, which keeps depth finite for any normals.
MAX_LOG = 40.0


@takes_files
def integrate(
    normals: NormalMap,
    camera: Camera | None = None,
    *,
    method: Method = "fast",
    distance: float | None = None,
    progress: Progress = silent,
) -> HeightMap:
    """The heights whose normals are closest to those given.

    Parameters
    ----------
    normals : NormalMap
        Normals in camera space.
    camera : Camera, optional
        The photo's camera; :func:`mpsnet_core.scene.camera.pixel_camera` by default.
    method : {"fast", "bilateral"}
        "fast" is least squares over all pixels: a continuous surface, smeared at depth discontinuities. "bilateral"
        preserves these: it cuts the links between pixels where one is likely.
    distance : float, optional
        Mean depth of each connected piece along a perspective camera's axis; 1 by default.
    progress : Progress
        Receives the fraction done and a message.

    Returns
    -------
    HeightMap
        Heights in the camera's unit. For an orthographic camera, each 4-connected piece of the mask has mean height 0.

    Raises
    ------
    GeometryError
        If the sizes of normals and camera differ.
    SettingsError
        If the method is unknown, or the distance is not above 0 or given for an orthographic camera.

    Examples
    --------
    >>> normals = NormalMap(np.broadcast_to([-0.6, 0, 0.8], (4, 4, 3)), np.ones((4, 4), bool))
    >>> np.round(integrate(normals).values[0], 3)
    array([-1.125, -0.375,  0.375,  1.125], dtype=float32)
    """
    height, width = normals.mask.shape
    camera = camera or pixel_camera(width, height)
    _check(normals, camera, method, distance)
    progress(0.0, "integrating")
    solve = fast if method == "fast" else bilateral
    box, mask = grained_box(normals.mask), normals.mask[grained_box(normals.mask)]
    # Not named here, so that the solver can release them: they take much memory for a large photo.
    depth = solve(gradients(normals, camera, box), part(progress, 0.0, 0.98))
    values = np.zeros(normals.mask.shape, np.float32)
    values[box] = _in_unit(depth, mask, camera, distance or 1.0)
    progress(1.0, "integrated")
    return HeightMap(values, normals.mask, camera)


def grained_box(mask: Bools) -> tuple[slice, slice]:
    """Rows and columns of the object, widened to multiples of GRAIN; heights there do not depend on the rest."""
    rows, columns = (
        slice(side.start & -GRAIN, min(side.stop + GRAIN - 1 & -GRAIN, length))
        for side, length in zip(bounding_box(mask), mask.shape, strict=True)
    )
    return rows, columns


def _check(normals: NormalMap, camera: Camera, method: str, distance: float | None) -> None:
    check_size("camera", (camera.height, camera.width), normals)
    check_choice("method", method, METHODS)
    if distance is None:
        return
    if not (np.isfinite(distance) and distance > 0):
        raise SettingsError(f"the distance must be a number above 0, not {distance}")
    if camera.projection == "orthographic":
        raise SettingsError("an orthographic camera sees no distance; leave it out, or give a perspective camera")


def _in_unit(depth: F32, mask: Bools, camera: Camera, distance: float) -> F32:
    """Heights from the solver's result, with the requested mean for each piece."""
    labels, sizes = labelled(mask)
    pieces, sizes = labels[mask], np.maximum(sizes, 1)
    inside = depth[mask].astype(np.float64) / pixels_per_unit(camera)
    inside -= (np.bincount(pieces, inside, len(sizes)) / sizes)[pieces]
    if camera.projection == "perspective":
        inside = np.exp(np.clip(inside, -MAX_LOG, MAX_LOG))
        inside *= distance / (np.bincount(pieces, inside, len(sizes)) / sizes)[pieces]
    values = np.zeros(mask.shape, np.float32)
    values[mask] = -inside
    return values
