"""Whether normals belong to a surface as they are, or turned or mirrored in the image.

The gradients of a surface have no curl, and mirrored or exchanged they have much. A turn by 180° leaves none either: it
turns bumps into hollows. But at an object's outline before its background, normals point outwards.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpsnet_core.arrays.gradient_derivatives import gradient_derivatives
from mpsnet_core.arrays.mask_regions import bounding_box, eroded
from mpsnet_core.arrays.resampling import block_means, gaussian
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot

# (8, 2, 2) what x and y may be turned by: nothing, mirrored in x, in y, turned by 180°, by 90° counter-clockwise and
# clockwise, exchanged, exchanged and reversed.
_ALONG, _ACROSS = [[1, 0, 0, 1], [-1, 0, 0, 1], [1, 0, 0, -1], [-1, 0, 0, -1]], [[0, -1, 1, 0], [0, 1, -1, 0]]
TURNS = np.array([*_ALONG, *_ACROSS, [0, 1, 1, 0], [0, -1, -1, 0]], np.float64).reshape(8, 2, 2)
SAME, HALF_TURN = 0, 3
# The object is divided into blocks: number along the side of a square of its area, pixels to use along a block's side,
# and least number of blocks in all.
BLOCKS, BLOCK_PIXELS, MIN_BLOCKS = 72, 6, 1200
ROWS_OF_BLOCKS = 8  # at a time, which bounds the memory
# Least number of cells of four blocks whose curl is measured.
MIN_CELLS = 300
# Blocks at the outline whose normals are compared with it: depth, softness of the outline in blocks, least steepness of
# the softened outline, and number for each sector of directions to count fully.
RIM, SOFT, STEEP, PER_SECTOR = 3, 1.5, 0.1, 8
SECTORS = 8
# Normals with a smaller z have no reliable gradients.
MIN_FACING = 0.15
# Least outwardness and convexity of a round object. The rim of a hollow plaque looks like that of a bump that is turned
# by 180°.
ROUND = (0.5, 0.25)
# Weights of the measures, by the maximum likelihood of the right lights of 1,305 photos of 440 rendered samples.
WEIGHTS = np.array([33.5, -8.9, -5.8, 7.7])
TINY = 1e-9
WHOLE = 0.999  # least share of a block inside the object


class Outline(NamedTuple):
    """The outline of an object before its background."""

    rim: Bools
    """(H, W). Blocks of the object at the outline."""
    outwards: F64
    """(H, W, 2). Unit vectors across it to the background, y up."""


class Blocks(NamedTuple):
    """An object in an image, reduced to blocks."""

    values: F64
    """(h, w, C). Means of the blocks."""
    whole: Bools
    """(h, w). Blocks that are completely inside the object."""
    outline: Outline
    """The object's outline, in blocks."""


def blocks_of(values: Floats, mask: Bools) -> Blocks | None:
    """The object of an image (H, W, C) and its mask (H, W) in blocks; None if it is too small."""
    side = np.sqrt(np.count_nonzero(mask)) / BLOCKS
    thin = max(1, int(side / BLOCK_PIXELS))
    mask = mask[::thin, ::thin]
    if np.count_nonzero(mask) < MIN_BLOCKS:
        return None
    box = bounding_box(mask)
    border = [(part.start == 0, part.stop >= size) for part, size in zip(box, mask.shape, strict=True)]
    values, inside, factor = values[::thin, ::thin][box], mask[box][..., None], max(1, round(side / thin))

    def means_of(rows: slice) -> F32:
        pixels = np.where(inside[rows], values[rows], 0).astype(np.float32)
        return block_means(np.concatenate([pixels, inside[rows]], axis=-1, dtype=np.float32), factor)

    means = np.concatenate([means_of(rows) for rows in bands(len(inside), ROWS_OF_BLOCKS * factor)])
    covered = means[..., -1]
    whole = covered > WHOLE
    if np.count_nonzero(whole) < MIN_BLOCKS:
        return None
    return Blocks(means[..., :-1].astype(np.float64), whole, outline_of(covered, border))


def outline_of(covered: Floats, border: Sequence[tuple[bool, bool]]) -> Outline:
    """The outline of an object that covers shares (H, W) of blocks.

    border: for rows and columns, whether the first and the last one are at the photo's border, where the object goes
    on.
    """
    margin = RIM + int(np.ceil(3 * SOFT)) + 1
    inner = (slice(margin, -margin),) * 2
    around = np.pad(covered.astype(np.float64), margin, mode="edge")
    for axis in (0, 1):
        for goes_on, places in zip(border[axis], (slice(margin), slice(-margin, None)), strict=True):
            if not goes_on:
                around[(slice(None),) * axis + (places,)] = 0
    # Far enough from the ends, beyond which the Gaussian takes zeros.
    down, right = np.gradient(gaussian(around, SOFT, (0, 1)))
    outwards = np.stack([-right, down], axis=-1)[inner]
    steep = np.linalg.norm(outwards, axis=-1)
    rim = (covered > WHOLE) & ~eroded(around > 0.5, RIM)[inner] & (steep > STEEP)
    return Outline(rim, outwards / np.maximum(steep, TINY)[..., None])


def orientation_measures(normals: Floats, usable: Bools, outline: Outline) -> F64:
    """(8, 4) measures of normals (H, W, 3), turned by each of :data:`TURNS`; their order is that of :data:`WEIGHTS`.

    usable: (H, W) where normals are as good as they can be; the curl is measured there.

    How far the normals at the outline point outwards, from -1 to 1; logarithms of the curl as a share of all
    derivatives, in each cell and in all; and how far the surface bulges, in the same share. The last three are 0 if
    there are too few cells.
    """
    leaning = _outwardness(normals, outline)
    along_x, along_y = gradient_derivatives(normals, usable, MIN_FACING)
    measures = np.zeros((len(TURNS), 4))
    measures[:, 0] = np.einsum("tij,ij->t", TURNS, leaning)
    if len(along_x) < MIN_CELLS:
        return measures
    size = np.sqrt(dot(along_x, along_x) + dot(along_y, along_y))
    share = size + 0.1 * np.median(size) + TINY
    x, y = (along @ TURNS.swapaxes(1, 2) for along in (along_x, along_y))
    curl = np.abs(y[..., 0] - x[..., 1])
    measures[:, 1] = np.log((curl / share).mean(axis=1) + TINY)
    measures[:, 2] = np.log(curl.mean(axis=1) / (size.mean() + TINY) + 1e-3)
    measures[:, 3] = -((x[..., 0] + y[..., 1]) / share).mean(axis=1)
    return measures


def _outwardness(normals: Floats, outline: Outline) -> F64:
    """(2, 2) mean products of the normals' x and y with the directions outwards.

    The mean is over sectors of directions; those without an outline count as 0.
    """
    outwards = outline.outwards[outline.rim]
    products = normals[outline.rim][:, :2, None] * outwards[:, None]
    angles = np.arctan2(outwards[:, 1], outwards[:, 0])
    sectors = np.floor(angles * (SECTORS / (2 * np.pi))).astype(np.int64) % SECTORS
    sums = np.zeros((SECTORS, 2, 2))
    np.add.at(sums, sectors, products)
    counts = np.bincount(sectors, minlength=SECTORS)
    return np.asarray((sums / np.maximum(counts, PER_SECTOR)[:, None, None]).mean(axis=0))


def probabilities(measures: F64) -> F64:
    """(N,) of candidates with measures (N, 4), one of which is right."""
    # Steep normals at the outline, as those of round objects, count more than their share.
    scores = np.concatenate([measures[:, :1] * np.abs(measures[:, :1]), measures[:, 1:]], axis=1) @ WEIGHTS
    shares = np.exp(scores - scores.max())
    return np.asarray(shares / shares.sum())


def is_round(measures: F64) -> bool:
    """Whether a candidate's measures (4,) are those of a round object, which tells it from itself turned by 180°."""
    return bool(measures[0] >= ROUND[0] and measures[3] >= ROUND[1])
