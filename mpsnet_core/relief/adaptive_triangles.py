"""Adaptive triangulation of a height field: few triangles where it is flat, many where it bends, and no cracks.

Right-triangulated irregular networks: Evans, Kirkpatrick and Townsend, Right-Triangulated Irregular Networks,
Algorithmica 30 (2001). A triangle is split at the midpoint of its longest side, always together with its neighbour
there. The error of not splitting is computed for each midpoint beforehand, and is at least that of all finer midpoints
within: the triangles of any tolerance fit together without cracks.
"""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, I32, Bools
from mpsnet_core.progress import Progress, silent

# The largest triangles are halves of squares with this many pixels on a side.
LARGEST = 256
# An outline error of one pixel counts as much as a surface error of this many.
OUTLINE_WEIGHT = 0.5

T = TypeVar("T", bound=np.generic)
# The search for a tolerance stops at this fraction of the requested triangles, or after this many rounds.
NEAR_ENOUGH, ROUNDS = 0.97, 20


def adaptive_triangles(values: F32, mask: Bools, pixel: float, most: int, progress: Progress = silent) -> I32:
    """(T, 3) pixel indices (row * W + column) of at most `most` triangles that approximate heights `values` (H, W).

    Their corners lie in the mask, (H, W) bool, and are counter-clockwise in the image. There are none if `most` is too
    small even for the largest triangles, or the mask too small for one. pixel: size of a pixel, in the unit of the
    values.
    """
    height, width = mask.shape
    side = 1 << (min(LARGEST, max(height, width) - 1).bit_length() - 1) if mask.size > 1 else 1
    # Pad to whole squares: pixels and triangle corners beyond the image's border are clamped to it.
    padding = [(0, -(length - 1) % side) for length in (height, width)]
    mask = np.pad(mask, padding, mode="edge")
    progress(0.0, "triangles")
    errors = _errors(np.pad(values, padding, mode="edge"), mask, pixel, side)
    progress(0.4, "triangles")
    ordered = np.sort(errors[errors > 0])[::-1]
    # n splits give about 2 n triangles, minus those outside the mask.
    best = np.empty((0, 3), np.int32)
    enough, too_many, tried = -1, len(ordered) + 1, min(most // 2, len(ordered))
    for turn in range(ROUNDS):
        progress(0.4 + 0.6 * turn / ROUNDS, "triangles")
        tolerance = float(ordered[tried]) if tried < len(ordered) else 0.0
        found = _leaves(errors, mask, tolerance, side, (height, width))
        if len(found) <= most:
            enough, best = tried, found
        else:
            too_many = tried
        if too_many - enough <= 1 or len(best) >= NEAR_ENOUGH * most:
            break
        unbounded = too_many > len(ordered)
        tried = min(tried + max(1, most - len(found)), len(ordered)) if unbounded else (enough + too_many) // 2
    return best


def _errors(values: F32, mask: Bools, pixel: float, side: int) -> F32:
    """(H, W) error, in the unit of the values, of not splitting the longest side that has its midpoint there."""
    errors = np.zeros(mask.shape, np.float32)
    step = 1
    while step < side:
        outline = np.float32(OUTLINE_WEIGHT * pixel * step)
        for turned in (np.transpose, np.asarray):
            _along_rows(turned(errors), turned(values), turned(mask), outline, step)
        _across_squares(errors, values, mask, outline, step)
        step *= 2
    return errors


def _along_rows(errors: F32, values: F32, mask: Bools, outline: np.float32, step: int) -> None:
    """Fill in the errors at the midpoints of sides along rows, which reach `step` pixels to the left and right."""
    rows, middle = slice(0, None, 2 * step), slice(step, None, 2 * step)
    threes = (middle, slice(0, -step, 2 * step), slice(2 * step, None, 2 * step))
    own = _deviation([values[rows, place] for place in threes], [mask[rows, place] for place in threes], outline)
    if step > 1:
        # Include finer midpoints: the centres of the four squares of `step` pixels around this one.
        squares = errors[step // 2 :: step, step // 2 :: step]
        beside = np.pad(np.maximum(squares[:, ::2], squares[:, 1::2]), ((1, 1), (0, 0)))
        own = np.maximum(own, np.maximum(beside[::2], beside[1::2]))
    errors[rows, middle] = own


def _across_squares(errors: F32, values: F32, mask: Bools, outline: np.float32, step: int) -> None:
    """Fill in the errors at the midpoints of diagonals, in squares of 2 `step` pixels. Diagonals alternate."""
    first, middle, last = slice(0, -step, 2 * step), slice(step, None, 2 * step), slice(2 * step, None, 2 * step)
    falling = np.indices(errors[middle, middle].shape).sum(axis=0) % 2 == 0

    def threes(field: NDArray[T]) -> list[NDArray[T]]:
        one = np.where(falling, field[first, first], field[first, last])
        other = np.where(falling, field[last, last], field[last, first])
        return [field[middle, middle], one, other]

    own = _deviation(threes(values), threes(mask), outline)
    level, upright = errors[:: 2 * step, middle], errors[middle, :: 2 * step]
    for sides in (level[:-1], level[1:], upright[:, :-1], upright[:, 1:]):
        own = np.maximum(own, sides)
    errors[middle, middle] = own


def _deviation(values: list[F32], inside: list[Bools], outline: np.float32) -> F32:
    """Distance of midpoints from the line between the ends; `outline` where the mask's edge runs between the three.

    values, inside: of the midpoints, of one end and of the other.
    """
    middle, one, other = values
    off = np.abs(middle - (one + other) / 2)
    count = sum(part.astype(np.int8) for part in inside)
    return np.where(count == 3, off, np.where(count == 0, np.float32(0), outline))


def _leaves(errors: F32, mask: Bools, tolerance: float, side: int, picture: tuple[int, int]) -> I32:
    """(T, 3) corners, as pixel indices of the image, of the triangles in the mask that need not be split."""
    height, width = mask.shape
    rows, columns = np.mgrid[0 : height - 1 : side, 0 : width - 1 : side].reshape(2, -1)
    top_left = rows * width + columns
    top_right, bottom_left, bottom_right = top_left + side, top_left + side * width, top_left + side * (width + 1)
    falling = (rows + columns) // side % 2 == 0
    halves = [
        np.where(
            falling, np.stack([bottom_right, top_left, bottom_left]), np.stack([bottom_left, top_right, top_left])
        ),
        np.where(
            falling, np.stack([top_left, bottom_right, top_right]), np.stack([top_right, bottom_left, bottom_right])
        ),
    ]
    # The two ends of the longest side, and the opposite corner.
    one, other, corner = np.concatenate(halves, axis=1)
    flat, inside = errors.ravel(), mask.ravel()
    leaves = []
    for _ in range(2 * (side.bit_length() - 1)):
        middle = (one + other) // 2
        split = flat[middle] > tolerance
        leaves.append(np.stack([one, other, corner])[:, ~split])
        one, other, corner, middle = one[split], other[split], corner[split], middle[split]
        one, other, corner = np.concatenate([[corner, one, middle], [other, corner, middle]], axis=1)
    triangles = np.concatenate([*leaves, np.stack([one, other, corner])], axis=1)
    rows, columns = np.divmod(triangles[:, inside[triangles].all(axis=0)], width)
    rows, columns = np.minimum(rows, picture[0] - 1), np.minimum(columns, picture[1] - 1)
    (y, x), (other_y, other_x) = ((line[1] - line[0], line[2] - line[0]) for line in (rows, columns))
    spread = y * other_x != x * other_y
    return (rows * picture[1] + columns)[:, spread].T.astype(np.int32)
