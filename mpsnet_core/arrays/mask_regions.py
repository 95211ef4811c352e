"""Connected components of graphs."""

from collections.abc import Callable

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F64, I32, I64, Bools, Floats


def connected(count: int, one: I64, other: I64) -> I64:
    """(count,) the smallest node of each node's connected component, given the edges (one, other).

    Union-find, all edges at a time.

    >>> connected(5, np.array([4, 1]), np.array([2, 2])).tolist()
    [0, 1, 1, 3, 1]
    """
    root = np.arange(count)
    while True:
        a, b = root[one], root[other]
        separate = a != b
        if not separate.any():
            return root
        one, other = one[separate], other[separate]
        a, b = a[separate], b[separate]
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(root, root[root]):
            root = root[root]


# ----------------------------------------------------------------------------------------------------------------------
# Connected regions, holes and morphology of masks; box filters.


# Maps regions' labels (H, W) and sizes to (regions + 1,) which of them to select.
Chosen = Callable[[I32, I64], Bools]


def labelled(mask: Bools, *, diagonal: bool = False) -> tuple[I32, I64]:
    """The mask's connected regions.

    diagonal: whether pixels that touch at a corner are connected as well.

    Returns (H, W) each pixel's label, from 1, and 0 outside the mask; and (regions + 1,) the size of each region in
    pixels, that of the outside first.
    """
    height, width = mask.shape
    # Runs of pixels, row by row: a column of background at either side separates the rows.
    padded = np.zeros((height, width + 2), np.int8)
    padded[:, 1:-1] = mask
    steps = np.diff(padded, axis=1).ravel()
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)  # positions in rows of width + 1
    roots = connected(len(starts), *_touching(starts, ends, width + 1, int(diagonal)))
    parts = np.unique(roots, return_inverse=True)[1].reshape(-1)
    sizes = np.bincount(parts, ends - starts, parts.max(initial=-1) + 1).astype(np.int64)
    numbers = np.zeros(height * (width + 1) + 1, np.int32)
    numbers[starts] = parts + 1
    numbers[ends] -= (parts + 1).astype(np.int32)
    labels = np.cumsum(numbers[:-1], dtype=np.int32).reshape(height, width + 1)[:, :-1]
    return labels, np.concatenate([[mask.size - sizes.sum()], sizes])


def bounding_box(mask: Bools, margin: int = 0) -> tuple[slice, slice]:
    """The rows and columns of the bounding box of a non-empty mask, with a margin in pixels.

    They are slices, whose stop may be beyond the image.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)).tolist() for axis in (1, 0))
    first, last = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    return slice(first, rows[-1] + margin + 1), slice(last, columns[-1] + margin + 1)


def remove_small_regions(mask: Bools, min_size: float) -> Bools:
    """The mask's connected regions of at least `min_size` pixels."""
    labels, sizes = labelled(mask)
    large = sizes >= min_size
    large[0] = False
    return large[labels]


def fill_small_holes(mask: Bools, max_size: float) -> Bools:
    """The mask with holes of at most `max_size` pixels filled: background that does not reach the image's border."""
    return fill_holes(mask, lambda labels, sizes: sizes <= max_size)


def fill_holes(mask: Bools, chosen: Chosen) -> Bools:
    """The mask with the holes filled that `chosen` selects from :func:`labelled`'s labels and sizes."""
    labels, sizes = labelled(~mask, diagonal=True)
    hole = chosen(labels, sizes)
    for border in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        hole[border] = False
    hole[0] = True  # the mask itself
    return hole[labels]


def dilated(mask: Bools, pixels: int) -> Bools:
    """The mask (H, W) or (H, W, C) dilated by a square of 2 pixels + 1."""
    for axis in (0, 1):
        grown = np.empty(mask.shape, bool)
        lines, out = np.moveaxis(mask, axis, 0), np.moveaxis(grown, axis, 0)
        places = np.arange(len(lines))
        ahead, behind = np.minimum(places + pixels + 1, len(lines)), np.maximum(places - pixels, 0)
        for part in bands(lines.shape[1]):
            marks = np.zeros((len(lines) + 1, *lines[:, part].shape[1:]), np.int32)
            np.cumsum(lines[:, part], axis=0, out=marks[1:])
            out[:, part] = marks[ahead] > marks[behind]
        mask = grown
    return mask


def box_sums(values: Floats | Bools, reach: int) -> F64:
    """(H, W) sums over the square of 2 reach + 1 pixels around each pixel, zero beyond the edges."""
    (height, width), side = values.shape, 2 * reach + 1
    padded = np.zeros((height + side, width + side))
    padded[reach + 1 : reach + 1 + height, reach + 1 : reach + 1 + width] = values
    down = np.cumsum(padded, axis=0)
    across = np.cumsum(down[side:] - down[:-side], axis=1)
    return across[:, side:] - across[:, :-side]


def eroded(mask: Bools, pixels: int) -> Bools:
    """The mask eroded by a square of 2 pixels + 1; beyond the image's border counts as inside."""
    return ~dilated(~mask, pixels)


def _touching(starts: I64, ends: I64, stride: int, reach: int) -> tuple[I64, I64]:
    """Pairs of runs that touch from one row to the next, as two arrays of their indices."""
    # For each run, those a row above that end after its start and start before its end.
    first = np.searchsorted(ends, starts - stride - reach, side="right")
    last = np.searchsorted(starts, ends - stride + reach, side="left")
    counts = np.maximum(last - first, 0)
    below = np.repeat(np.arange(len(starts)), counts)
    above = np.arange(len(below)) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
    return below, above
