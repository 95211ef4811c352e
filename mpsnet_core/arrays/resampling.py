"""Sampling of large images on a regular grid of rows and columns."""

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, I64, Bools, Floats


def grid_step(count: int, wanted: int) -> int:
    """Step in rows and columns that leaves about `wanted` of `count` pixels; 1 for all."""
    return max(1, round(math.sqrt(count / wanted)))


def sampled_rows(mask: Bools, wanted: int) -> Iterator[tuple[slice, Bools]]:
    """Yield about `wanted` pixels spread over a mask (H, W): a row as a slice, and (1, W) which of its pixels."""
    step = grid_step(np.count_nonzero(mask), wanted)
    for row in range(0, len(mask), step):
        chosen = np.zeros((1, mask.shape[1]), bool)
        chosen[:, ::step] = mask[row, ::step]
        yield slice(row, row + 1), chosen


# ----------------------------------------------------------------------------------------------------------------------
# Bilinear lookup between the pixels of an image.


def bilinear(
    image: NDArray[Any], x: Floats, y: Floats, dtype: DTypeLike = np.float64, *, repeat: bool = False
) -> Floats:
    """Values of an image (H, W) or (H, W, C) at pixel coordinates `x` to the right and `y` down, in their shape.

    Pixel centres are at index + 0.5. Beyond the outermost centres, values are clamped to the border, or the image
    repeats. They are computed and returned as `dtype`.

    >>> bilinear(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([0.5, 1.0, 9.0]), np.array([0.5, 1.0, 0.0])).tolist()
    [0.0, 1.5, 1.0]
    >>> bilinear(np.array([[0.0, 1.0], [2.0, 3.0]]), np.array([-1.5, 2.0]), np.array([4.5, 0.5]), repeat=True).tolist()
    [0.0, 0.5]
    """
    height, width = image.shape[:2]
    if repeat:
        x, y = np.mod(x - 0.5, width), np.mod(y - 0.5, height)
    else:
        x, y = np.clip(x - 0.5, 0, width - 1), np.clip(y - 0.5, 0, height - 1)
    left, top = x.astype(np.int64), y.astype(np.int64)
    right, below = left + 1, top + 1
    alone = (1,) * (image.ndim - 2)
    across, down = (part.astype(dtype).reshape(*part.shape, *alone) for part in (x - left, y - top))
    if repeat:  # a remainder just below the width may be rounded to it
        left, top, right, below = left % width, top % height, right % width, below % height
    else:
        right, below = np.minimum(right, width - 1), np.minimum(below, height - 1)
    pixels = image.reshape(height * width, *image.shape[2:])
    upper, upper_right, lower, lower_right = (
        pixels.take(row * width + column, axis=0).astype(dtype, copy=False)
        for row in (top, below)
        for column in (left, right)
    )
    upper += (upper_right - upper) * across
    lower += (lower_right - lower) * across
    upper += (lower - upper) * down
    return upper


# ----------------------------------------------------------------------------------------------------------------------
# Downsampling by block means.


def block_means(pixels: Floats, factor: int) -> F32:
    """(⌈H/factor⌉, ⌈W/factor⌉, C) means of blocks of factor x factor pixels. Non-finite values count as 0."""
    if factor == 1:
        return np.nan_to_num(pixels.astype(np.float32), copy=False, posinf=0, neginf=0)
    height, width, channels = pixels.shape
    starts = np.arange(0, width, factor)
    counts = np.diff([*starts, width])[:, None]
    small = np.empty((-(-height // factor), len(starts), channels), np.float32)
    for row in range(len(small)):
        rows = np.nan_to_num(pixels[row * factor : (row + 1) * factor], posinf=0, neginf=0)
        small[row] = np.add.reduceat(rows.mean(axis=0, dtype=np.float32), starts, axis=0) / counts
    return small


def means_inside(image: F32, mask: Bools, halvings: int) -> tuple[F32, Bools]:
    """Means (h, w, C) of an image (H, W, C) over a mask (H, W), in blocks of 2**halvings pixels on a side.

    Also returns (h, w) which blocks contain pixels of the mask; the mean of others is 0. The image must be finite
    outside the mask, too.
    """
    if halvings == 0:
        return np.where(mask[..., None], image, np.float32(0)), mask
    total = np.concatenate([image, np.ones((*mask.shape, 1), np.float32)], axis=-1) * mask[..., None]
    for _ in range(halvings):
        total = np.pad(total, [(0, total.shape[0] % 2), (0, total.shape[1] % 2), (0, 0)])
        total = total[0::2] + total[1::2]
        total = total[:, 0::2] + total[:, 1::2]
    return total[..., :-1] / np.maximum(total[..., -1:], 1), total[..., -1] > 0


# ----------------------------------------------------------------------------------------------------------------------
# Reduced sizes for smooth images, and bilinear upsampling back.


def reduced_shape(height: int, width: int, longest: int) -> tuple[int, int]:
    """Height and width of an image scaled down to at most `longest` pixels on its longer side.

    >>> reduced_shape(3000, 6000, 1024)
    (512, 1024)
    """
    scale = min(1.0, longest / max(height, width))
    return max(1, round(height * scale)), max(1, round(width * scale))


def chosen_pixels(small_height: int, small_width: int, height: int, width: int) -> tuple[I64, I64]:
    """(h,) rows and (w,) columns of a large image's pixels at the centres of a small one's.

    The other way round, with the sizes swapped, those of the small image's pixels that contain the large one's centres.
    """
    rows = ((np.arange(small_height) + 0.5) * height / small_height).astype(np.int64)
    columns = ((np.arange(small_width) + 0.5) * width / small_width).astype(np.int64)
    return rows, columns


def upsampled(values: F32, shape: tuple[int, ...], rows: slice) -> F32:
    """Values (h, w, ...) of a small image, interpolated bilinearly for `rows` of a large one of `shape` (H, W)."""
    return _along(_along(values, 0, shape[0], rows), 1, shape[1], slice(None))


def _along(values: F32, axis: int, length: int, chosen: slice) -> F32:
    count = values.shape[axis]
    if count == length:
        return values[(slice(None),) * axis + (chosen,)]
    position = np.clip((np.arange(length)[chosen] + 0.5) * count / length - 0.5, 0, count - 1)
    first = np.minimum(position.astype(np.int64), max(count - 2, 0))
    weight = (position - first).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(values.ndim)])
    low, high = values.take(first, axis), values.take(np.minimum(first + 1, count - 1), axis)
    return low + weight * (high - low)


# ----------------------------------------------------------------------------------------------------------------------
# Smooth extrapolation of an image into its unknown pixels.


def push_pull(values: F32, known: Bools) -> F32:
    """Values (H, W) or (H, W, C), extrapolated smoothly from where they are `known`, (H, W) bool, to all other pixels.

    An image pyramid: each level halves the image by the mean of the known pixels among four, and unknown pixels are
    interpolated bilinearly from the coarser level. This is push-pull of Gortler et al., "The Lumigraph" (SIGGRAPH
    1996), with full weight for a coarse pixel that contains any known one. If nothing is known, values are unchanged.
    """
    if known.all() or known.size == 1:
        return values
    height, width, *channels = values.shape
    half_height, half_width = -(-height // 2), -(-width // 2)
    total = np.zeros((half_height, half_width, *channels), np.float32)
    count = np.zeros((half_height, half_width), np.uint8)
    for down, right in np.ndindex(2, 2):
        inside = known[down::2, right::2]
        place = np.s_[: inside.shape[0], : inside.shape[1]]
        total[place] += np.where(_like(inside, values), values[down::2, right::2], np.float32(0))
        count[place] += inside
    total /= np.maximum(_like(count, total), 1)
    coarse = push_pull(total, count > 0)
    whole = np.empty_like(values)
    for rows in bands(height):
        beyond = upsampled(coarse, (2 * half_height, 2 * half_width), rows)[:, :width]
        whole[rows] = np.where(_like(known[rows], beyond), values[rows], beyond)
    return whole


def _like(picture: NDArray[np.generic], values: F32) -> NDArray[np.generic]:
    """An image (H, W) in a shape that broadcasts with values (H, W) or (H, W, C)."""
    return picture if values.ndim == 2 else picture[..., None]


# ----------------------------------------------------------------------------------------------------------------------
# Gaussian smoothing.


BAND = 64  # rows


def gaussian(values: Floats, sigma: float, axes: Iterable[int]) -> Floats:
    """Values smoothed by a Gaussian of standard deviation `sigma` along these axes; zero beyond their ends.

    >>> gaussian(np.array([0.0, 0.0, 1.0, 0.0, 0.0]), 0.5, [0]).round(2).tolist()
    [0.0, 0.11, 0.79, 0.11, 0.0]
    """
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel = (kernel / kernel.sum()).astype(values.dtype)
    # A product with a small matrix for each band of rows takes a fifth of the time of a sum over the kernel.
    band = np.zeros((BAND, BAND + 2 * reach), values.dtype)
    for row in range(BAND):
        band[row, row : row + len(kernel)] = kernel
    for axis in axes:
        rows = np.moveaxis(values, axis, 0)
        padded = np.pad(rows.reshape(len(rows), -1), [(reach, reach), (0, 0)])
        smooth = np.empty_like(padded[: len(rows)])
        for start in range(0, len(rows), BAND):
            count = min(BAND, len(rows) - start)
            end = count + 2 * reach
            smooth[start : start + count] = band[:count, :end] @ padded[start : start + end]
        values = np.moveaxis(smooth.reshape(rows.shape), 0, axis)
    return values
